//! The solver over a batch.

use super::RapierConfig;
use super::frame::Workspace;
use crate::batch::Batch;
use crate::solver::parallel::Parallel;
use crate::solver::{Capabilities, Solver, StepError};

/// rapier as a [`Solver`]. Remembers nothing of an environment between frames.
pub struct Rapier {
    config: RapierConfig,
    parallel: Parallel<Workspace>,
}

impl Rapier {
    /// A solver with these settings.
    pub fn new(config: RapierConfig) -> Self {
        Self { config, parallel: Parallel::new() }
    }
}

impl Solver for Rapier {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.config.check().map_err(StepError::Solver)?;
        self.parallel.step(&self.config, batch, torques)
    }
    fn capabilities(&self) -> Capabilities {
        Parallel::<Workspace>::CAPABILITIES
    }
}
