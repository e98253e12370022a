//! Rollouts beside recorded motion.

use super::tally::{PassiveReport, Tally};
use crate::prelude::*;

/// Pieces of recorded trajectories of equal length, side by side.
#[derive(Clone)]
pub struct Pieces {
    /// The robot, as the solver is to have it.
    pub system: Arc<System>,
    /// Where it was.
    pub scene: Arc<Scene>,
    /// Frames that a solver is shown before it goes on alone.
    pub before: usize,
    /// States `[frame][piece][q, qd]`, one more than frames.
    pub states: Vec<Vec<f64>>,
    /// Torques `[frame][piece][joint]`.
    pub torques: Vec<Vec<f64>>,
}

impl Pieces {
    /// How many.
    pub fn count(&self) -> usize {
        self.states[0].len() / self.system.robot.state_dim()
    }

    /// Frames that a solver goes alone.
    pub fn frames(&self) -> usize {
        self.torques.len() - self.before
    }

    /// Errors of a solver that is shown the first frames and rolls out the others.
    ///
    /// # Errors
    /// If it can step none, or one of those that it is shown.
    pub fn compare(&self, solver: &mut dyn Solver) -> Result<PassiveReport, StepError> {
        let (n, d) = (self.count(), self.system.robot.state_dim());
        let mut batch = Batch::new(&self.system, &self.scene, n);
        for env in 0..n {
            batch.reset(env, &self.states[0][env * d..(env + 1) * d]);
            solver.reset(env);
        }
        for frame in 0..self.before {
            solver.step(&mut batch, &self.torques[frame])?;
            // As it was, whatever the solver thinks; what remembers takes it for the next frame.
            batch.states.copy_from_slice(&self.states[frame + 1]);
        }
        let (first, mut tally) = (&self.states[self.before], Tally::new(&self.system, n));
        for frame in self.before..self.torques.len() {
            tally.step(solver, (&mut batch, &self.torques[frame]), [&self.states[frame + 1], first])?;
        }
        Ok(tally.report(self.frames()))
    }
}
