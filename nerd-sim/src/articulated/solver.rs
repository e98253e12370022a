//! Articulated dynamics as a solver over a batch of environments.

use super::kick::{PASSES, SETTLED};
use super::{config::Settings, gradients::covered, workspace::Workspace};
use crate::prelude::*;
use crate::{solver::Gradients, solver::parallel::Parallel};

/// Articulated dynamics as a [`Solver`]. The next state depends on state, torques and scene alone.
pub struct Articulated {
    settings: Settings,
    parallel: Parallel<Workspace>,
}

impl Articulated {
    /// Creates a solver with the settings `config`.
    pub fn new(config: ArticulatedConfig) -> Self {
        Self { settings: Settings { config, settling: (SETTLED, PASSES) }, parallel: Parallel::new() }
    }

    /// Sets the tolerance on relative changes of drags (see `kick.rs`) and the most solves per substep. For tests:
    /// gradients assume a converged solve.
    #[doc(hidden)]
    pub fn settling(mut self, share: f64, solves: usize) -> Self {
        self.settings.settling = (share, solves);
        self
    }

    /// Does the same as [`Solver::vjp`], and adds gradients with respect to the numbers of each environment's robot and
    /// scene. Their order is that of [`super::numbers`].
    ///
    /// These count as constant: dry friction of 0, contact points with a moving locus, and contact laws of pairs of
    /// geoms. A pair's law that is a multiple of the material still varies with the material.
    pub fn back_by_numbers(
        &mut self,
        batch: &Batch,
        torques: &[f64],
        rows: usize,
        grad_next: &[f64],
    ) -> Result<Gradients, StepError> {
        self.goes_back(batch)?;
        self.parallel.back(&self.settings, batch, torques, rows, grad_next, true)
    }

    fn goes_back(&self, batch: &Batch) -> Result<(), StepError> {
        self.settings.config.check().map_err(StepError::Solver)?;
        covered(&self.settings.config, batch)
    }
}

impl Solver for Articulated {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.settings.config.check().map_err(StepError::Solver)?;
        self.parallel.step(&self.settings, batch, torques)
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        self.goes_back(batch)?;
        self.parallel.back(&self.settings, batch, torques, rows, grad_next, false)
    }

    fn capabilities(&self) -> Capabilities {
        Parallel::<Workspace>::CAPABILITIES
    }
}
