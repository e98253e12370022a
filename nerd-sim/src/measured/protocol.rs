//! Open-loop rollouts from measured states.
//!
//! A window is 80 samples, the measured start among them; windows begin at every fourth sample of a toss. The whole toss is one
//! more rollout, from the first sample to the last.

use std::sync::Arc;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use nerd_core::state::{quaternion, vector};
use rayon::prelude::*;

use super::MeasuredError;
use super::cube::lowest;
use super::data::{DT, Sample, Toss};
use crate::prelude::*;

/// Samples of a window.
pub const WINDOW: usize = 80;
/// What a metre of the files is short of a metre, as rest height and free fall say.
pub const METRIC: f64 = 0.979;

/// Poses, one a frame.
pub type Motion = Vec<Isometry3<f64>>;
/// Makes a solver for a system, in any thread.
pub type Make<'a> = dyn Fn(&Arc<System>) -> Box<dyn Solver> + Sync + 'a;

/// A start and what was measured from there on.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Toss it is of.
    pub toss: u64,
    /// Whether the start is before the first contact.
    pub flying: bool,
    /// The start.
    pub start: Sample,
    /// Poses, the start's first.
    pub measured: Motion,
}

/// Windows of all tosses that begin at every `every`-th sample; lengths divided by `scale`.
pub fn windows(tosses: &[Toss], every: usize, scale: f64) -> Vec<Trial> {
    let cut = |toss: &Toss| {
        let all = (0..(toss.samples.len() + 1).saturating_sub(WINDOW)).step_by(every.max(1));
        all.map(|first| trial(toss, first, WINDOW, scale)).collect::<Vec<_>>()
    };
    tosses.iter().flat_map(cut).collect()
}

/// Whole tosses.
pub fn whole(tosses: &[Toss], scale: f64) -> Vec<Trial> {
    tosses.iter().map(|toss| trial(toss, 0, toss.samples.len(), scale)).collect()
}

fn trial(toss: &Toss, first: usize, length: usize, scale: f64) -> Trial {
    let samples = &toss.samples[first..first + length];
    let measured = samples.iter().map(|s| s.scaled(scale).pose).collect();
    Trial { toss: toss.id, flying: first < toss.first_contact, start: samples[0].scaled(scale), measured }
}

/// Raises starts out of the table, until the lowest corner touches it: a compliant table throws a cube out that begins within.
pub fn lifted(trials: &[Trial]) -> Vec<Trial> {
    let lift = |trial: &Trial| {
        let mut trial = trial.clone();
        trial.start.pose.translation.z += (-lowest(&trial.start.pose)).max(0.0);
        trial
    };
    trials.iter().map(lift).collect()
}

/// Rolls every trial out with the cube and the table of `system` ([`Cube::system`](super::Cube::system)) under the solver that
/// `make` makes, in as many threads as there are. A rollout that the solver cannot finish stands still from there on; how many
/// did.
///
/// # Errors
/// If `system` has no scene `ground`.
pub fn roll(system: &Arc<System>, make: &Make<'_>, trials: &[Trial]) -> Result<(Vec<Motion>, usize), MeasuredError> {
    let scene = system.scene("ground")?;
    let begin = || (make(system), Batch::new(system, &scene, 1));
    let done: Vec<(Motion, bool)> = trials
        .par_iter()
        .map_init(begin, |(solver, batch), trial| {
            batch.reset(0, &trial.start.state());
            solver.reset(0);
            let mut lost = false;
            let mut motion = vec![trial.start.pose];
            for _ in 1..trial.measured.len() {
                lost = lost || solver.step(batch, &[]).is_err();
                let state = batch.state(0);
                motion.push(Isometry3::from_parts(vector(state).into(), quaternion(&state[3..7])));
            }
            (motion, lost)
        })
        .collect();
    let lost = done.iter().filter(|d| d.1).count();
    Ok((done.into_iter().map(|d| d.0).collect(), lost))
}

/// Predicts that nothing moves.
pub fn still(trial: &Trial) -> Motion {
    vec![trial.start.pose; trial.measured.len()]
}

/// Predicts flight, and that the first touch ends it.
pub fn flight(trial: &Trial) -> Motion {
    let Sample { pose, velocity, spin } = trial.start;
    let at = |k: usize| {
        let t = k as f64 * DT;
        let p = pose.translation.vector + velocity * t - Vector3::z() * (0.5 * 9.81 * t * t);
        Isometry3::from_parts(p.into(), UnitQuaternion::from_scaled_axis(spin * t) * pose.rotation)
    };
    let mut motion = vec![pose];
    while motion.len() < trial.measured.len() {
        let last = motion[motion.len() - 1];
        motion.push(if lowest(&last) < 0.0 { last } else { at(motion.len()) });
    }
    motion
}
