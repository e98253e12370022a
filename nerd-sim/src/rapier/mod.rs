//! rapier's reduced-coordinate multibodies behind [`crate::solver::Solver`], set up so that the next state is a
//! function of state, torques and scene alone: every frame starts from a fresh world, so no warm start, contact cache or
//! sleep state is carried over.
//!
//! What is the same as in [`crate::articulated`]: inertias, armature, joint damping, the spring law of limits, the places
//! at which contact is looked for, the mean friction coefficient of a pair. What is not: contacts are rapier's stiff
//! unilateral constraints (no [`crate::scene::Material`] stiffness or damping), and the integrator is of first order.

mod config;
mod frame;
mod template;

use frame::Workspace;

pub use config::RapierConfig;

use crate::{internal::*, solver::parallel::Parallel};

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
