//! What a body needs on a device: the text of its kernels, forward and backward, and the shape of its numbers.

use std::sync::Arc;

use nerd_sim::scene::Scene;
use nerd_sim::system::System;

use super::body::{Body, Place};

/// Numbers of a rollout, as the host sends it: motion, first frame of the update, whether it restarts, four of its view.
pub const ROLLOUT: usize = 7;

/// Numbers of a row.
#[derive(Clone, Copy, Debug)]
pub struct Widths {
    /// Of a state, and of a gradient by it.
    pub state: usize,
    /// Of what a frame keeps for its way back.
    pub kept: usize,
    /// Of a token.
    pub inputs: usize,
    /// Torques of a frame that are seen, the first ones.
    pub torques: usize,
    /// Threads of a rollout: a block of its own, or none but one thread.
    pub threads: Option<usize>,
}

/// A body that has kernels.
pub trait OnCard: Body {
    /// Of its rows.
    fn widths(&self) -> Widths;
    /// The text for so many rollouts, in scenes of at most so many colliders.
    fn program(&self, system: &Arc<System>, rollouts: usize, colliders: usize) -> String;
    /// A scene as numbers.
    fn record(&self, system: &System, scene: &Scene, colliders: usize) -> Result<Vec<f64>, String>;
    /// A view as numbers.
    fn numbers(view: &Self::View) -> [f64; 4];

    /// A rollout's numbers.
    fn row(place: &Place<Self::View>, anew: bool) -> [f64; ROLLOUT] {
        let [a, b, c, d] = Self::numbers(&place.view);
        [place.motion as f64, place.frame as f64, f64::from(u8::from(anew)), a, b, c, d]
    }
}
