//! Solvers on a GPU: many environments, which stay there for all frames.

use nerd_sim::articulated::device::Real;
use nerd_train::{device::resident, evaluate::Held, learner::cuda::Precision, provenance::card_memory};

use crate::prelude::*;
use crate::roll::idle;

/// The arithmetics of a setting's products there, and their words.
pub fn arithmetics(setting: &Setting) -> &'static [(Precision, &'static str)] {
    let all = &[(Precision::F32, ""), (Precision::Tf32, ", TF32"), (Precision::F16, ", f16")];
    if matches!(setting, Setting::Neural(_)) { all } else { &all[..1] }
}

/// Errors of a solver there, and the microseconds of a frame of one of `n` environments that go on from those of `begun`, in turn, for so many
/// frames without torques, or on their way to their first targets; those that it gives up stay where they are. And this process's memory there.
pub fn timed(
    begun: &Batch,
    setting: &Setting,
    precision: Precision,
    [n, frames]: [usize; 2],
    held: Option<&Held>,
    compare: &dyn Fn(&mut dyn Solver) -> Result<PassiveReport, StepError>,
) -> Result<(PassiveReport, f64, Option<f64>)> {
    let mut solver = resident(setting, &begun.system, Real::F32, precision)?;
    let report = compare(&mut *solver)?;
    let (mut many, d) = (Batch::new(&begun.system, &begun.scenes[0], n), begun.system.robot.state_dim());
    many.states.chunks_exact_mut(d).zip(begun.states.chunks_exact(d).cycle()).for_each(|(to, from)| to.copy_from_slice(from));
    many.drives = held.map_or_else(Vec::new, |held| held.drives(0, n));
    let torques = idle(&many);
    let mut roll = |frames| solver.roll(&mut many, &torques, frames).or_else(|error| error.faults().map(drop));
    // Kernels are compiled and memory is taken once.
    roll(1)?;
    let started = Instant::now();
    roll(frames)?;
    Ok((report, 1e6 * started.elapsed().as_secs_f64() / (n * frames) as f64, card_memory(std::process::id())))
}
