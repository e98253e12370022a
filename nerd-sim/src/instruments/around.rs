//! Solvers around a solver.

use std::time::{Duration, Instant};

use crate::batch::Batch;
use crate::sampling::{normal, stream};
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

/// Keeps every state its solver comes to; [`super::Replay`] plays them back.
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

/// A solver, and normal noise (rad/s or m/s, by velocity) after each of its frames: how far apart a motion's own sensitivity drives what
/// differs a little. A model whose error is no larger than that of its shaken truth has nothing left to learn.
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
