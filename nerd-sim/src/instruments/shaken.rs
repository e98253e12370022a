//! A solver whose velocities are shaken after every frame: how far apart a motion's own sensitivity drives what differs a
//! little. A model whose error is no larger than that of its shaken truth has nothing left to learn.
//!
//! ```
//! # use nerd_sim::{instruments::{Hold, Shaken}, prelude::*};
//! # let system = System::named("pendulum")?;
//! # let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! let mut solver = Shaken::new(Hold, 0.01, 7);
//! solver.step(&mut batch, &[0.0; 2])?;
//! assert!(batch.state(0)[2] != 0.0 && batch.state(0)[2].abs() < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::batch::Batch;
use crate::sampling::{normal, stream};
use crate::solver::{Capabilities, Solver, StepError};

/// A solver, and normal noise (rad/s or m/s, by velocity) after each of its frames.
#[derive(Clone, Debug)]
pub struct Shaken<S = Box<dyn Solver>> {
    solver: S,
    noise: f64,
    seed: u64,
    frame: u64,
}

impl<S: Solver> Shaken<S> {
    /// Shakes a solver with noise of that standard deviation; that of frame t is a stream of its own, keyed by (seed, t).
    pub fn new(solver: S, noise: f64, seed: u64) -> Self {
        Self { solver, noise, seed, frame: 0 }
    }
}

impl<S: Solver> Solver for Shaken<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(batch, torques)?;
        let (mut rng, robot) = (stream(self.seed, self.frame), &batch.system.robot);
        self.frame += 1;
        for state in batch.states.chunks_exact_mut(robot.state_dim()) {
            state[robot.nq()..].iter_mut().for_each(|v| *v += self.noise * normal(&mut rng));
        }
        Ok(())
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}
