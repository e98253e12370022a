//! Times solvers on a GPU with many environments, whose states stay on the GPU for all frames.

use nerd_sim::articulated::device::Real;
use nerd_train::{evaluate::Held, learner::cuda::Precision, provenance::card_memory, spec::resident};

use super::Timed;
use crate::prelude::*;
use crate::roll::idle;

/// Number formats of a solver's matrix products on a GPU, each with its suffix in tables.
pub fn arithmetics(spec: &SolverSpec) -> &'static [(Precision, &'static str)] {
    let all = &[(Precision::F32, ""), (Precision::Tf32, ", TF32"), (Precision::F16, ", f16")];
    if spec.folder().is_some() { all } else { &all[..1] }
}

/// Measures a solver's errors, its time a frame, and the GPU memory of this process. For the time, `n` environments
/// start at the states of `begun` in turn. They are rolled out for `frames` frames, without torques or with drives
/// towards the first targets of `held`. Environments that the solver gives up stay in place.
pub fn timed(
    begun: &Batch,
    spec: &SolverSpec,
    precision: Precision,
    [n, frames]: [usize; 2],
    held: Option<&Held>,
    compare: &dyn Fn(&mut dyn Solver) -> Result<PassiveReport, StepError>,
) -> Result<Timed> {
    let mut solver = resident(spec, &begun.system, Real::F32, precision)?;
    let report = compare(&mut *solver)?;
    let mut many = Batch::new(&begun.system, &begun.scenes[0], n);
    let d = begun.system.robot.state_dim();
    many.states
        .chunks_exact_mut(d)
        .zip(begun.states.chunks_exact(d).cycle())
        .for_each(|(to, from)| to.copy_from_slice(from));
    many.drives = held.map_or_else(Vec::new, |held| held.drives(0, n));
    let torques = idle(&many);
    let mut roll = |frames| solver.roll(&mut many, &torques, frames).or_else(|error| error.faults().map(drop));
    // Compiles kernels and allocates memory before timing.
    roll(1)?;
    let started = Instant::now();
    roll(frames)?;
    let microseconds = 1e6 * started.elapsed().as_secs_f64() / (n * frames) as f64;
    Ok(Timed { report, microseconds, memory: card_memory(std::process::id()) })
}
