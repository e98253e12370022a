//! When a run ends before it is done: by a clock, or because its process was asked to, as by a signal.

use std::sync::MutexGuard;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::prelude::*;

/// The first signal that asked, and when.
static ASKED: Mutex<Option<(i32, Instant)>> = Mutex::new(None);
static HEEDING: AtomicUsize = AtomicUsize::new(0);

/// What is under way when time is over may go on for so long; then it is broken off, and what it did is lost.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);

/// A run that ends with a checkpoint once it is asked to, as long as this lives.
#[derive(Debug)]
pub struct Heed(());

/// Of this run.
pub fn heed() -> Heed {
    HEEDING.fetch_add(1, Ordering::SeqCst);
    Heed(())
}

impl Drop for Heed {
    fn drop(&mut self) {
        HEEDING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Asks all runs of this process to end, for a signal; whether there is one that will.
pub fn ask(signal: i32) -> bool {
    asking().get_or_insert((signal, Instant::now()));
    HEEDING.load(Ordering::SeqCst) > 0
}

/// The signal that asked for it, if one did.
pub fn asked() -> Option<i32> {
    asking().map(|asked| asked.0)
}

fn asking() -> MutexGuard<'static, Option<(i32, Instant)>> {
    ASKED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// When a run ends: at a moment, if there is one, or when it is asked to.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stop(pub Option<Instant>);

impl Stop {
    /// So many minutes after a moment.
    pub fn after(started: Instant, minutes: Option<f64>) -> Self {
        // More than a moment holds are no limit.
        Self(minutes.and_then(|minutes| started.checked_add(Duration::try_from_secs_f64(60.0 * minutes).ok()?)))
    }

    /// Whether to begin nothing more.
    pub fn due(self) -> bool {
        self.past(Duration::ZERO)
    }

    /// Ends what takes long and is under way.
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
