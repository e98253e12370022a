//! The rows of the suite, grouped by subject.

mod cables;
mod contact;
mod energy;
mod flight;
mod joints;
mod robots;
mod rolling;
mod round;
mod runner;

use super::bodies::{Body, UPRIGHT};
use super::row::{Row, row};
use super::trial::{Motion, Result, Trial, limp, rise};
use nerd_sim::prelude::*;
use rand::RngExt;

/// All rows, in the order of tables.
pub(super) fn all() -> impl Iterator<Item = &'static Row> {
    [
        flight::ROWS,
        joints::ROWS,
        contact::LANDING,
        contact::ROWS,
        rolling::ROWS,
        round::ROWS,
        contact::PASSIVE,
        robots::CONSISTENCY,
        cables::ROWS,
        robots::ROWS,
        runner::ROWS,
        energy::ROWS,
    ]
    .into_iter()
    .flatten()
}

/// The largest of values that are at least 0.
fn most(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// The largest figure of all cases.
fn worst<T>(cases: impl IntoIterator<Item = T>, figure: impl FnMut(T) -> Result<f64>) -> Result<f64> {
    cases.into_iter().map(figure).collect::<Result<Vec<_>>>().map(most)
}

/// Depth (m) to which the contact springs of a body at rest give, each by its share of the weight.
fn sunk(trial: &Trial, body: &Body, springs: f64) -> f64 {
    if trial.method.rigid { 0.0 } else { body.mass * GRAVITY / (springs * body.material[0]) }
}

/// Velocity (m/s) of a free body's origin.
fn velocity(state: &[f64]) -> Vector3<f64> {
    vector(&state[10..]) + vector(&state[7..]).cross(&vector(state))
}

/// Random torques, each up to `largest` (N m), from a stream of a seed.
fn pushes(seed: u64, stream_number: u64, largest: f64) -> impl FnMut(&[f64], &mut [f64]) {
    let mut random = stream(seed, stream_number);
    move |_, torques| torques.iter_mut().for_each(|torque| *torque = largest * (2.0 * random.random::<f64>() - 1.0))
}

/// Largest change of angular momentum, relative to the start, and of linear momentum without gravity's share, relative to
/// `scale` of the start.
fn momentum_change(motion: &Motion, scale: impl Fn(&Totals) -> f64) -> f64 {
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
