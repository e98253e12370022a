//! Training motions, and the starts of an update's rollouts.

use super::*;

/// Adam's betas: small, since gradients change as rollouts grow longer.
pub(super) const BETA: [f64; 2] = [0.9f32 as f64, 0.98f32 as f64];
/// Share of rollouts that restart although they could continue.
const ANEW: f64 = 0.1;

/// Motions, with the system and the length of rollouts.
#[derive(Clone)]
pub struct Course<B> {
    /// System in the motions.
    pub body: B,
    /// Training motions.
    pub train: Arc<Trajectories>,
    /// Motions for validation on single frames.
    pub validation: Arc<Trajectories>,
    /// Number H of frames in a rollout.
    pub frames: usize,
}

/// Random draw for a rollout: `place` is its start if it restarts, `anew` forces a restart.
pub(super) struct Draw<V> {
    pub anew: bool,
    pub place: Place<V>,
}

impl<B: Body> Course<B> {
    /// Refuses motions that are shorter than a rollout.
    pub(super) fn check(&self) -> LearnResult {
        let Self { train, validation, frames, .. } = self;
        if train.count == 0 || validation.count == 0 || train.frames < *frames || *frames == 0 {
            let motions = train.count;
            let long = train.frames;
            mismatch!("{motions} motions of {long} frames hold no rollout of {frames}");
        }
        Ok(())
    }

    /// Random draws for the `rows` rollouts of an update.
    pub(super) fn draws(&self, seed: u64, step: u64, rows: usize) -> Vec<Draw<B::View>> {
        let mut rng = stream(seed, step);
        let train = &self.train;
        // Draw all numbers for every rollout, so that one rollout never shifts the draws of another.
        let one = |_| {
            let anew = rng.random::<f64>() < ANEW;
            let mirrored = rng.random::<bool>();
            let motion = rng.random_range(0..train.count);
            let frame = rng.random_range(0..=train.frames - self.frames);
            let view = self.body.view(rng.random::<f64>() * std::f64::consts::TAU, mirrored);
            Draw { anew, place: Place { motion, frame, view } }
        };
        (0..rows).map(one).collect()
    }
}
