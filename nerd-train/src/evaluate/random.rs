//! Random torques as in training data.

use nerd_sim::dataset::{Act, Drive, Smooth};

use crate::prelude::*;

/// Torques of [`super::Action::Random`], with one stream of draws for each environment.
pub(super) struct Random {
    factor: f64,
    drive: Drive,
    streams: Vec<ChaCha8Rng>,
    curves: Vec<Option<Smooth>>,
}

impl Random {
    /// Streams of `seed`, and smooth curves where the robot has them, from the states of `batch`.
    pub(super) fn new(batch: &Batch, factor: f64, seed: u64) -> Self {
        let system = &batch.system;
        let mut streams = (0..batch.len() as u64).map(|env| stream(seed, env)).collect_vec();
        let curve = |(env, rng): (usize, &mut _)| Smooth::new(system, batch.state(env), factor, rng);
        let curves = streams.iter_mut().enumerate().map(curve).collect();
        Self { factor, drive: Drive::new(system), streams, curves }
    }

    /// Draws the torques of a frame, `[env][joint]` (N m or N), at the states of `batch`.
    pub(super) fn draw(&mut self, batch: &Batch, torques: &mut [f64]) {
        let joints = batch.system.robot.joint_count();
        for (env, rng) in self.streams.iter_mut().enumerate() {
            let out = &mut torques[env * joints..(env + 1) * joints];
            match &mut self.curves[env] {
                Some(curve) => curve.torques(batch.state(env), &batch.scenes[env], rng, out),
                None => self.drive.draw(batch.state(env), self.factor, rng, out),
            }
        }
    }
}
