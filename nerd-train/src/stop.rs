//! Early end of runs: by a time limit, or by a signal to the process.

use std::sync::MutexGuard;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::prelude::*;

/// The first signal, and when it arrived.
static ASKED: Mutex<Option<(i32, Instant)>> = Mutex::new(None);
/// Number of runs that end with a checkpoint after a signal.
static HEEDING: AtomicUsize = AtomicUsize::new(0);

/// Grace period for work in progress once a run should end. After it, the work is interrupted and lost.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);

/// Guard that [`heed`] returns. While it lives, a run of this process ends with a checkpoint after a signal.
#[derive(Debug)]
pub struct Heed(());

/// Registers a run that ends with a checkpoint after a signal.
pub fn heed() -> Heed {
    HEEDING.fetch_add(1, Ordering::SeqCst);
    Heed(())
}

impl Drop for Heed {
    fn drop(&mut self) {
        HEEDING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Asks all runs of this process to end because of a signal. Returns whether a run will respond.
pub fn ask(signal: i32) -> bool {
    asking().get_or_insert((signal, Instant::now()));
    HEEDING.load(Ordering::SeqCst) > 0
}

/// The first signal that asked the runs to end, if any.
pub fn asked() -> Option<i32> {
    asking().map(|asked| asked.0)
}

fn asking() -> MutexGuard<'static, Option<(i32, Instant)>> {
    ASKED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// When a run ends: at this moment, if given, or after a signal.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stop(pub Option<Instant>);

impl Stop {
    /// The end `minutes` after `started`; without minutes only a signal ends the run.
    pub fn after(started: Instant, minutes: Option<f64>) -> Self {
        // Minutes beyond the range of an instant are no limit.
        Self(minutes.and_then(|minutes| started.checked_add(Duration::try_from_secs_f64(60.0 * minutes).ok()?)))
    }

    /// Whether the run should end and begin nothing new.
    pub fn due(self) -> bool {
        self.past(Duration::ZERO)
    }

    /// Returns [`Error::Stopped`] once the grace period is over, to interrupt long work in progress.
    pub(crate) fn check(self) -> Result<()> {
        if self.past(PATIENCE) { Err(Error::Stopped) } else { Ok(()) }
    }

    fn past(self, patience: Duration) -> bool {
        let asked = asking().map(|asked| asked.1);
        [asked, self.0]
            .into_iter()
            .flatten()
            .any(|moment| Instant::now().checked_duration_since(moment).is_some_and(|past| past >= patience))
    }
}
