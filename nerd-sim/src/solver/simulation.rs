//! A batch with the solver that advances it.

use super::{Solver, StepError};
use crate::batch::Batch;

/// A batch with the solver that advances it; assign `solver` to swap it mid-run.
pub struct Simulation {
    /// States and scenes.
    pub batch: Batch,
    /// What advances them.
    pub solver: Box<dyn Solver>,
}

impl Simulation {
    /// From a batch and a solver.
    pub fn new(batch: Batch, solver: impl Solver + 'static) -> Self {
        Self { batch, solver: Box::new(solver) }
    }

    /// One frame; see [`Solver::step`].
    pub fn step(&mut self, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(&mut self.batch, torques)
    }

    /// Puts one environment at `state`; the solver forgets its past.
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        self.batch.reset(env, state);
        self.solver.reset(env);
    }
}
