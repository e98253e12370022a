//! Time of a frame: the minimum over several runs on one core. Every published timing comes from here.

use nerd_sim::instruments::Timed;

use crate::evaluate::PassiveReport;
use crate::prelude::*;

/// Runs repeat until they took this time together, at most [`MOST`] times. Up to [`SOME`] longer runs are made while
/// together they took less than [`PATIENCE`].
const TIME: Duration = Duration::from_millis(300);
const MOST: usize = 20;
const SOME: usize = 3;
const PATIENCE: Duration = Duration::from_secs(10);

/// Calls `run` several times and returns the shortest time. Other load on the machine can only make a run slower.
fn best<E>(mut run: impl FnMut() -> Result<Duration, E>) -> Result<Duration, E> {
    let mut runs = 0;
    let mut total = Duration::ZERO;
    let mut best = Duration::MAX;
    while runs == 0 || (total < TIME && runs < MOST) || (runs < SOME && total < PATIENCE) {
        let spent = run()?;
        (runs, total, best) = (runs + 1, total + spent, best.min(spent));
    }
    Ok(best)
}

/// Errors of a solver against the truth, and its time per frame (us), both from the same calls of `compare`. `frames`
/// is the number of frames that one call steps.
pub fn timed(
    solver: Box<dyn Solver>,
    frames: usize,
    compare: impl Fn(&mut dyn Solver) -> Result<PassiveReport, StepError>,
) -> Result<(PassiveReport, f64), StepError> {
    let mut solver = Timed::new(solver);
    let mut report = None;
    let best = best(|| {
        solver.spent = Duration::ZERO;
        report = Some(compare(&mut solver)?);
        Ok::<_, StepError>(solver.spent)
    })?;
    let report = report.ok_or_else(|| StepError::Solver("it never ran".into()))?;
    Ok((report, each(best, frames)))
}

/// Microseconds per frame, if `frames` frames took `spent`.
pub fn each(spent: Duration, frames: usize) -> f64 {
    spent.as_secs_f64() * 1e6 / frames as f64
}

/// Powers of two: 1, 2, 4, .. up to `last`.
pub fn powers(last: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(1), |n| Some(2 * n)).take_while(move |n| *n <= last)
}

/// Runs `work` in a rayon pool of one thread.
pub fn on_one_core<T: Send, E: From<Error> + Send>(work: impl FnOnce() -> Result<T, E> + Send) -> Result<T, E> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|e| Error::Refused(format!("no thread to time on: {e}")))?
        .install(work)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_of_as_many_runs_as_fit_counts() {
        let runs = |seconds: f64| {
            let mut runs = 0;
            let best = best(|| -> Result<_> {
                runs += 1;
                Ok(Duration::from_secs_f64(seconds / f64::from(runs)))
            });
            (runs, best.map_or(f64::NAN, |b| b.as_secs_f64() / seconds))
        };
        let [short, long, endless] = [1e-6, 1.0, 60.0].map(runs);
        assert_eq!((short.0, long.0, endless.0), (20, 3, 1), "runs of what is short, long and very long");
        assert_eq!((short.1, endless.1), (0.05, 1.0), "the shortest counts");
    }
}
