//! What a chain's network learns from, and where the rollouts of an update start.

use std::ops::Range;
use std::sync::Arc;

use nerd_model::chain::{Chain, OUTPUTS};
use nerd_sim::sampling::stream;
use rand::RngExt;

use super::data::Motions;
use super::loss::Loss;
use super::view::View;
use crate::learner::LearnError;

/// Mean distance (m) of nodes from the truth beyond which a rollout teaches nothing of it any more.
pub(super) const ASTRAY: f64 = 0.03;
/// Adam's betas: small, since gradients change as rollouts grow longer.
pub(super) const BETA: [f64; 2] = [0.9f32 as f64, 0.98f32 as f64];
/// Share of rollouts that restart in an update although they could continue.
const ANEW: f64 = 0.1;

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

pub(super) struct Draw {
    /// Whether it restarts unconditionally.
    pub anew: bool,
    /// Where it begins if it does.
    pub motion: usize,
    pub frame: usize,
    pub view: View,
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

    /// The loss of its rollouts.
    pub fn loss(&self) -> Loss {
        Loss::new(&self.scale, self.velocity, self.frames)
    }

    /// The draws of some rows of an update's rollouts.
    pub(super) fn draws(&self, chain: &Chain, seed: u64, step: u64, rows: Range<usize>) -> Vec<Draw> {
        let (mut rng, round, train) = (stream(seed, step), chain.round(), &self.train);
        // All numbers are drawn, whatever becomes of them, so that one rollout's fate moves no other, on whichever rank.
        let mut one = |_| {
            let (anew, mirrored) = (rng.random::<f64>() < ANEW, rng.random::<bool>());
            let (motion, frame) = (rng.random_range(0..train.len()), rng.random_range(0..=train.frames - self.frames));
            let yaw = rng.random::<f64>() * std::f64::consts::TAU;
            Draw { anew, motion, frame, view: View::new(if round { yaw } else { 0.0 }, round && mirrored) }
        };
        (0..rows.end).map(&mut one).collect::<Vec<_>>().split_off(rows.start)
    }
}
