//! Predictors without physics: what any model must beat.

use crate::batch::Batch;
use crate::solver::{Solver, StepError, commit};
use crate::system::System;

/// Stays where it is: its error is that of knowing nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hold;

impl Solver for Hold {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Goes on at the velocity it has: better than [`Hold`] for a few frames, mostly worse for many.
#[derive(Clone, Copy, Debug, Default)]
pub struct Glide;

impl Solver for Glide {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        let (d, time) = (batch.system.robot.state_dim(), batch.system.frame_time);
        next.chunks_exact_mut(d).for_each(|state| glide(&batch.system, state, time));
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Moves a state `[q, qd]` on by `time` (s) at constant joint velocities, angular velocity and velocity of the root. Endless
/// angles are not wrapped.
pub fn glide(system: &System, state: &mut [f64], time: f64) {
    let (q, qd) = system.robot.split(state);
    qd.to_local(&system.robot, q).advance(&system.robot, state, time);
}
