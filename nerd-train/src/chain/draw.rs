//! Draws the starts of an update's rollouts.

use std::ops::Range;

use nerd_model::chain::Chain;
use nerd_sim::sampling::stream;
use rand::RngExt;

use super::data::Motions;
use super::view::View;

/// Share of rollouts that restart in an update although they could continue.
const ANEW: f64 = 0.1;

/// What is drawn of a rollout.
pub(crate) struct Draw {
    /// Whether it restarts unconditionally.
    pub anew: bool,
    /// Where it begins if it does.
    pub motion: usize,
    pub frame: usize,
    pub view: View,
}

/// The draws of some rows of an update's rollouts, of so many frames each.
pub(crate) fn draws(chain: &Chain, motions: &Motions, frames: usize, seed: u64, step: u64, rows: Range<usize>) -> Vec<Draw> {
    let (mut rng, round) = (stream(seed, step), chain.round());
    // All numbers are drawn, whatever becomes of them, so that one rollout's fate moves no other, on whichever rank.
    let mut one = |_| {
        let (anew, mirrored) = (rng.random::<f64>() < ANEW, rng.random::<bool>());
        let (motion, frame) = (rng.random_range(0..motions.len()), rng.random_range(0..=motions.frames - frames));
        let yaw = rng.random::<f64>() * std::f64::consts::TAU;
        Draw { anew, motion, frame, view: View::new(if round { yaw } else { 0.0 }, round && mirrored) }
    };
    (0..rows.end).map(&mut one).collect::<Vec<_>>().split_off(rows.start)
}
