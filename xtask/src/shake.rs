//! A solver whose velocities are shaken after every frame: how far apart a motion's own sensitivity drives what differs a little.

use nerd_sim::prelude::*;
use nerd_sim::sampling::stream;
use rand::RngExt;

/// A solver, and normal noise (rad/s or m/s, by velocity) after each of its frames.
pub struct Shaken {
    solver: Box<dyn Solver>,
    noise: f64,
    seed: u64,
    frame: u64,
}

impl Shaken {
    /// Shakes a solver; noise of frame t is a stream of its own, keyed by (seed, t).
    pub fn new(solver: Box<dyn Solver>, noise: f64, seed: u64) -> Self {
        Self { solver, noise, seed, frame: 0 }
    }
}

impl Solver for Shaken {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(batch, torques)?;
        let (mut rng, robot) = (stream(self.seed, self.frame), &batch.system.robot);
        self.frame += 1;
        for state in batch.states.chunks_exact_mut(robot.state_dim()) {
            for v in &mut state[robot.nq()..] {
                let (u, angle) = (1.0 - rng.random::<f64>(), std::f64::consts::TAU * rng.random::<f64>());
                *v += self.noise * (-2.0 * u.ln()).sqrt() * angle.cos();
            }
        }
        Ok(())
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }
}
