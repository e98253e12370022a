//! Rollouts of a truth, with which any number of solvers are compared.

use nerd_sim::instruments::{Hold, Recorder, Replay};

use crate::evaluate::{PassiveConfig, PassiveReport, passive};
use crate::prelude::*;

/// A truth's frames from a protocol's starts.
pub struct Comparison<'a> {
    system: &'a Arc<System>,
    scene: &'a Arc<Scene>,
    protocol: PassiveConfig,
    /// States after each frame, `[frame][start][q, qd]`.
    pub frames: Vec<Vec<f64>>,
}

impl<'a> Comparison<'a> {
    /// Rolls out the truth.
    ///
    /// # Errors
    /// If the truth cannot step.
    pub fn with(
        truth: Box<dyn Solver>,
        system: &'a Arc<System>,
        scene: &'a Arc<Scene>,
        protocol: PassiveConfig,
    ) -> Result<Self, StepError> {
        let mut recorder = Recorder::new(truth);
        passive(system, scene, &mut recorder, &mut Hold, protocol, &mut |_| ())?;
        Ok(Self { system, scene, protocol, frames: recorder.frames })
    }

    /// The same starts with another truth's frames.
    #[must_use]
    pub fn of(&self, frames: Vec<Vec<f64>>) -> Self {
        Self { frames, ..*self }
    }

    /// Errors of a solver against the truth.
    ///
    /// # Errors
    /// If the solver cannot step.
    pub fn errors(&self, solver: &mut dyn Solver) -> Result<PassiveReport, StepError> {
        passive(self.system, self.scene, &mut Replay::new(&self.frames), solver, self.protocol, &mut |_| ())
    }

    /// Number of frames that a call of [`Comparison::errors`] steps.
    pub fn work(&self) -> usize {
        self.protocol.starts * self.protocol.steps
    }
}
