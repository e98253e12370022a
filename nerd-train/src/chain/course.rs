//! The data that a chain's network learns from.

use std::sync::Arc;

use nerd_model::chain::OUTPUTS;

use super::data::Motions;
use crate::learner::LearnError;

/// Mean distance (m) of nodes from the truth beyond which a rollout teaches nothing of it any more.
pub(super) const ASTRAY: f64 = 0.03;
/// Adam's betas: small, since gradients change as rollouts grow longer.
pub(super) const BETA: [f64; 2] = [0.9f32 as f64, 0.98f32 as f64];

/// Motions and what is asked of them.
#[derive(Clone)]
pub struct Course {
    /// Motions that rollouts follow.
    pub train: Arc<Motions>,
    /// Motions that single frames are validated on.
    pub validation: Arc<Motions>,
    /// What 1 means of each number that the network predicts ([`super::scales`]).
    pub scale: [f64; OUTPUTS],
    /// Mean change of a node's velocity over a frame (m/s).
    pub velocity: f64,
    /// Frames of a rollout, H.
    pub frames: usize,
}

impl Course {
    /// Refuses motions that are shorter than a rollout.
    pub(super) fn check(&self) -> Result<(), LearnError> {
        let Self { train, validation, frames, .. } = self;
        if train.is_empty() || validation.is_empty() || train.frames < *frames || *frames == 0 {
            let (motions, long) = (train.len(), train.frames);
            return Err(LearnError::Mismatch(format!("{motions} motions of {long} frames hold no rollout of {frames}")));
        }
        Ok(())
    }
}
