//! The predictor of constant velocity: better than [`super::Hold`] for a few frames, mostly worse for many.
//!
//! ```
//! # use nerd_sim::{instruments::Glide, prelude::*};
//! # let system = System::named("cartpole")?;
//! # let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! batch.reset(0, &[0.0, 0.0, 3.0, 0.0]);
//! Glide.step(&mut batch, &[0.0; 2])?;
//! assert!((batch.state(0)[0] - 3.0 * system.frame_time).abs() < 1e-12, "the cart moves at 3 m/s");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::batch::Batch;
use crate::solver::{Solver, StepError, commit};
use crate::system::System;

/// Goes on at the velocity it has.
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
