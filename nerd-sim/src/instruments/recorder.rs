//! Every state a solver comes to, kept; [`super::Replay`] plays them back.
//!
//! ```
//! # use nerd_sim::{instruments::{Hold, Recorder}, prelude::*};
//! # let system = System::named("pendulum")?;
//! # let mut batch = Batch::new(&system, &system.scene("free")?, 5);
//! let mut solver = Recorder::new(Hold);
//! solver.step(&mut batch, &[0.0; 10])?;
//! assert_eq!((solver.frames.len(), solver.frames[0].len()), (1, 5 * 4));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::batch::Batch;
use crate::solver::{Capabilities, Solver, StepError};

/// Keeps every state its solver comes to.
#[derive(Clone, Debug)]
pub struct Recorder<S = Box<dyn Solver>> {
    /// The solver.
    pub solver: S,
    /// States `[env][q, qd]` after each frame.
    pub frames: Vec<Vec<f64>>,
}

impl<S: Solver> Recorder<S> {
    /// Around a solver; nothing is kept yet.
    pub fn new(solver: S) -> Self {
        Self { solver, frames: Vec::new() }
    }
}

impl<S: Solver> Solver for Recorder<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let done = self.solver.step(batch, torques);
        // Environments that were set aside keep their states; the frame counts for the others.
        if matches!(done, Ok(()) | Err(StepError::Environments(_))) {
            self.frames.push(batch.states.clone());
        }
        done
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}
