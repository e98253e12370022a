//! What a frame costs: the shortest of some runs, on one core. Everything that is timed for a figure is timed here.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nerd_model::folder::ModelConfig;
use nerd_sim::instruments::{Replay, Timed};
use nerd_sim::prelude::*;

use crate::error::{Error, Result};
use nerd_train::device::Device;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive};

/// How often something is run to be timed. What disturbs a run makes it longer, so the shortest counts.
#[derive(Clone, Copy, Debug)]
pub struct Repeat {
    /// No more runs than these.
    pub most: usize,
    /// These, unless they take too long.
    pub some: usize,
    /// As many as fit into this.
    pub time: Duration,
    /// Too long for another one before there are `some`.
    pub patience: Duration,
}

impl Repeat {
    /// So many runs, however long they take.
    pub fn times(n: usize) -> Self {
        Self { most: n, some: n, time: Duration::ZERO, patience: Duration::MAX }
    }

    /// As many as fit into 0.3 s, at most twenty; three if they fit into 10 s; one at least.
    pub fn briefly() -> Self {
        Self { most: 20, some: 3, time: Duration::from_millis(300), patience: Duration::from_secs(10) }
    }

    /// The shortest of the times that `run` says it took.
    ///
    /// # Errors
    /// The first of `run`.
    pub fn best<E>(self, mut run: impl FnMut() -> Result<Duration, E>) -> Result<Duration, E> {
        let (mut runs, mut total, mut best) = (0, Duration::ZERO, Duration::MAX);
        while runs == 0 || (total < self.time && runs < self.most) || (runs < self.some && total < self.patience) {
            let spent = run()?;
            (runs, total, best) = (runs + 1, total + spent, best.min(spent));
        }
        Ok(best)
    }
}

/// A solver's errors against these frames of a truth, and the microseconds of a frame of its own, by time and errors of the same
/// steps.
///
/// # Errors
/// If it cannot step.
pub fn timed(
    (system, scene): (&Arc<System>, &Arc<Scene>),
    solver: Box<dyn Solver>,
    truth: &[Vec<f64>],
    protocol: PassiveConfig,
) -> Result<(PassiveReport, f64), StepError> {
    let (mut solver, mut report) = (Timed::new(solver), None);
    let best = Repeat::briefly().best(|| {
        solver.spent = Duration::ZERO;
        report = Some(passive(system, scene, &mut Replay::new(truth), &mut solver, protocol, &mut |_| ())?);
        Ok(solver.spent)
    })?;
    let report = report.ok_or_else(|| StepError::Solver("it never ran".into()))?;
    Ok((report, each(best, protocol.starts * protocol.steps)))
}

/// Microseconds of one of `frames` frames that took so long.
pub fn each(spent: Duration, frames: usize) -> f64 {
    spent.as_secs_f64() * 1e6 / frames as f64
}

/// Works with one thread, whatever else the program has.
///
/// # Errors
/// Those of `work`, and if there is no thread to be had.
pub fn on_one_core<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    one.map_err(|e| Error::msg(format!("cannot start a thread: {e}")))?.install(work)
}

/// Microseconds that a model takes for a frame of one environment on one core of the CPU, best of five.
///
/// # Errors
/// If the model cannot be read or cannot step.
pub fn microseconds(folder: &Path, system: &Arc<System>, scene: &Arc<Scene>) -> Result<f64> {
    let protocol = PassiveConfig { starts: 256, steps: 40, seed: 501, action: Action::Zero };
    let truth = ModelConfig::truth_of(folder)?;
    on_one_core(|| {
        let best = Repeat::times(5).best(|| -> Result<Duration> {
            let mut learned = Timed::new(Device::Cpu.neural(folder, system, None, protocol.starts)?);
            passive(system, scene, &mut *truth.solver(system), &mut learned, protocol, &mut |_| ())?;
            Ok(learned.spent)
        })?;
        Ok(each(best, protocol.starts * protocol.steps))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_of_as_many_runs_as_were_asked_for_counts() {
        let of = |repeat: Repeat, seconds: f64| {
            let mut runs = 0;
            let best = repeat.best(|| -> Result<_> {
                runs += 1;
                Ok(Duration::from_secs_f64(seconds / f64::from(runs)))
            });
            (runs, best.map(|b| b.as_secs_f64()).unwrap_or(f64::NAN))
        };
        assert_eq!(of(Repeat::times(5), 100.0), (5, 20.0));
        assert_eq!(of(Repeat::briefly(), 1e-6).0, 20, "what is short is run often");
        assert_eq!(of(Repeat::briefly(), 1.0).0, 3, "what is long is run three times");
        assert_eq!(of(Repeat::briefly(), 60.0).0, 1, "what is very long is run once");
    }
}
