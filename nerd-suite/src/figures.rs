//! Measured figures and torques that several rows use.

use nerd_sim::prelude::*;
use rand::RngExt;

use super::bodies::Body;
use super::trial::{Motion, Result, Trial};

/// Returns the largest of `values`, or 0 if none is positive.
pub fn most(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// Measures the figure of each case, and returns the largest.
pub fn worst<T>(cases: impl IntoIterator<Item = T>, figure: impl FnMut(T) -> Result<f64>) -> Result<f64> {
    cases.into_iter().map(figure).collect::<Result<Vec<_>>>().map(most)
}

/// Penetration depth (m) of a body at rest whose weight rests on `springs` contact springs; 0 for rigid contacts.
pub fn sunk(trial: &Trial, body: &Body, springs: f64) -> f64 {
    if trial.method.rigid { 0.0 } else { body.mass * GRAVITY / (springs * body.material[0]) }
}

/// Velocity (m/s, world axes) of a free body's origin.
pub fn velocity(state: &[f64]) -> Vector3<f64> {
    vector(&state[10..]) + vector(&state[7..]).cross(&vector(state))
}

/// Draws random torques between -`largest` and `largest` (N m) for each frame, from a random stream of a seed.
pub fn pushes(seed: u64, stream_number: u64, largest: f64) -> impl FnMut(&[f64], &mut [f64]) {
    let mut random = stream(seed, stream_number);
    move |_, torques| torques.iter_mut().for_each(|torque| *torque = largest * (2.0 * random.random::<f64>() - 1.0))
}

/// Largest relative change of momentum over a motion. Angular momentum is divided by its start value, linear momentum
/// without gravity's share by `scale` of the start.
pub fn momentum_change(motion: &Motion, scale: impl Fn(&Totals) -> f64) -> f64 {
    let totals = motion.totals();
    let system = &motion.system;
    let first = &totals[0];
    most(totals.iter().enumerate().map(|(k, t)| {
        let given = system.gravity() * (first.mass * k as f64 * system.frame_time);
        let l = t.momentum.ang - first.momentum.ang;
        let p = t.momentum.lin - first.momentum.lin - given;
        (l.norm() / first.momentum.ang.norm()).max(p.norm() / scale(first))
    }))
}
