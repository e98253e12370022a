//! The solver over a batch.

use super::kick::{PASSES, SETTLED};
use super::{config::Settings, slopes::covered, workspace::Workspace};
use crate::prelude::*;
use crate::{solver::Slopes, solver::parallel::Parallel};

/// Articulated dynamics as a [`Solver`]. Remembers nothing of an environment between frames.
pub struct Articulated {
    settings: Settings,
    parallel: Parallel<Workspace>,
}

impl Articulated {
    /// A solver with these settings.
    pub fn new(config: ArticulatedConfig) -> Self {
        Self { settings: Settings { config, settling: (SETTLED, PASSES) }, parallel: Parallel::new() }
    }

    /// Solves a substep until no drag changes by more than this share, over the substeps of a frame, in so many solves at most. For tests:
    /// slopes are those of what is solved without an error.
    #[doc(hidden)]
    pub fn settling(mut self, share: f64, solves: usize) -> Self {
        self.settings.settling = (share, solves);
        self
    }

    /// As [`Solver::back`], with gradients by the numbers of each environment's robot and scene, too, in the order of [`super::numbers`].
    ///
    /// Dry friction that is not there, contact points that move over their link, and what a file says of a pair of geoms beyond multiples of the
    /// material are held.
    pub fn back_by_numbers(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.goes_back(batch)?;
        self.parallel.back(&self.settings, batch, torques, rows, by_next, true)
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

    fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.goes_back(batch)?;
        self.parallel.back(&self.settings, batch, torques, rows, by_next, false)
    }

    fn capabilities(&self) -> Capabilities {
        Parallel::<Workspace>::CAPABILITIES
    }
}
