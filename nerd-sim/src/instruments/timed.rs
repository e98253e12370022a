//! How long a solver takes.
//!
//! ```
//! # use nerd_sim::{instruments::{Hold, Timed}, prelude::*};
//! # let system = System::named("pendulum")?;
//! # let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! let mut solver = Timed::new(Hold);
//! solver.step(&mut batch, &[0.0; 2])?;
//! println!("{:.1} us", solver.spent.as_secs_f64() * 1e6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::time::{Duration, Instant};

use crate::batch::Batch;
use crate::solver::{Capabilities, Solver, StepError};

/// Adds up the time its solver takes, and nothing else's.
#[derive(Clone, Debug)]
pub struct Timed<S = Box<dyn Solver>> {
    /// The solver.
    pub solver: S,
    /// Time its frames have taken; set it to zero to restart.
    pub spent: Duration,
}

impl<S: Solver> Timed<S> {
    /// Around a solver, from zero.
    pub fn new(solver: S) -> Self {
        Self { solver, spent: Duration::ZERO }
    }
}

impl<S: Solver> Solver for Timed<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let start = Instant::now();
        let done = self.solver.step(batch, torques);
        self.spent += start.elapsed();
        done
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}
