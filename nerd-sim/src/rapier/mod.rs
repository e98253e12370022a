//! rapier's reduced-coordinate multibodies behind [`crate::solver::Solver`], with a fresh world in every frame. The
//! next state is thus a function of state, torques and scene alone, without warm start, contact cache or sleeping.
//!
//! Shared with [`crate::articulated`]: inertias, armature, joint damping, the spring law of limits, candidate contact
//! points, friction coefficients, contact filters. Different: contacts are rapier's stiff unilateral constraints
//! without [`crate::scene::Material`] stiffness and damping, and the integrator is of first order.

mod config;
mod frame;
mod pairs;
mod template;

use frame::Workspace;

pub use config::RapierConfig;

use crate::{internal::*, solver::parallel::Parallel};

/// rapier as a [`Solver`], without memory between frames.
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
