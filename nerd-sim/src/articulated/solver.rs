//! The solver over a batch.

use super::config::ArticulatedConfig;
use super::workspace::Workspace;
use crate::batch::Batch;
use crate::solver::parallel::Parallel;
use crate::solver::{Capabilities, Solver, StepError};

/// Articulated dynamics as a [`Solver`]. Remembers nothing of an environment between frames.
pub struct Articulated {
    config: ArticulatedConfig,
    parallel: Parallel<Workspace>,
}

impl Articulated {
    /// A solver with these settings.
    pub fn new(config: ArticulatedConfig) -> Self {
        Self { config, parallel: Parallel::new() }
    }
}

impl Solver for Articulated {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.config.check().map_err(StepError::Solver)?;
        self.parallel.step(&self.config, batch, torques)
    }
    fn capabilities(&self) -> Capabilities {
        Parallel::<Workspace>::CAPABILITIES
    }
}
