//! The trait of systems that are rolled out.

use super::*;

/// A system in a rollout: its observation, step and loss, each with a hand-written vector-Jacobian product (VJP).
pub trait Body: Clone + Send + Sync {
    /// Augmentation of a motion, such as a turn and a reflection.
    type View: Copy + Send + Sync;
    /// State before or after a frame, transformed by the view of the motion.
    type State: Clone + Send + Sync;
    /// Gradient with respect to the state.
    type Slope: Clone + Send + Sync;
    /// Record of an observation, which a frame's backward pass needs beside the state before the frame.
    type Look: Send;
    /// Working memory of a thread.
    type Memory;

    /// Working memory of a thread.
    fn memory(&self) -> Self::Memory;
    /// Number of tokens of one state.
    fn tokens(&self) -> usize;
    /// View of a motion: yaw (rad), and whether it is mirrored.
    fn view(&self, yaw: f64, mirrored: bool) -> Self::View;
    /// Recorded state at a place of a motion, transformed by the view of the place.
    fn truth(&self, motions: &Trajectories, place: &Place<Self::View>) -> Self::State;
    /// Observes a state at a place of a motion; appends the network's normalised input tokens to `tokens`.
    fn look(
        &self,
        state: &Self::State,
        at: (&Trajectories, &Place<Self::View>),
        memory: &mut Self::Memory,
        tokens: &mut Vec<f32>,
    ) -> Self::Look;
    /// State after the frame, from the network's normalised outputs.
    fn advance(
        &self,
        before: &Self::State,
        look: &Self::Look,
        outputs: &[f32],
        memory: &mut Self::Memory,
    ) -> Self::State;
    /// Zero gradient.
    fn level(&self) -> Self::Slope;
    /// Loss of a `[predicted, true]` pair of states after frame k (counted from 1), times `weight`. Adds the loss's
    /// gradient to `gradient`.
    fn loss(&self, pair: [&Self::State; 2], k: usize, weight: f64, gradient: &mut Self::Slope) -> f64;
    /// Adds the upstream gradient of `later` later frames to the frame's gradient `own`, times the factor of the
    /// function `join`.
    fn join(&self, own: &mut Self::Slope, upstream: &Self::Slope, later: usize);
    /// Gradient with respect to the network's outputs, from the `upstream` gradient with respect to the state after the
    /// frame. Adds to `gradient` the gradient with respect to the state before the frame that bypasses network and
    /// observation.
    fn advance_back(
        &self,
        before: &Self::State,
        outputs: &[f32],
        upstream: &Self::Slope,
        gradient: &mut Self::Slope,
    ) -> Vec<f32>;
    /// Adds to `gradient` the gradient with respect to the state before a frame that passes through the observation. It
    /// follows from the gradients with respect to the tokens (`by_tokens`) and the state after the frame (`upstream`).
    fn look_back(
        &self,
        before: &Self::State,
        look: &Self::Look,
        by_tokens: &[f32],
        upstream: &Self::Slope,
        gradient: &mut Self::Slope,
        memory: &mut Self::Memory,
    );
    /// Whether a rollout is close enough to the truth to continue in the next update. Continued rollouts train the
    /// network on states that it predicted.
    fn near(&self, state: &Self::State, truth: &Self::State) -> bool;
    /// Error of a network's prediction after one frame, relative to the true change over the frame. Taken at `frames`
    /// evenly spaced frames.
    fn missed(&self, motions: &Trajectories, network: &Loaded, frames: usize) -> f64;
}

/// A frame of a motion.
#[derive(Clone, Copy, Debug)]
pub struct Place<V> {
    /// Index of the motion.
    pub motion: usize,
    /// Frames since the start of the motion.
    pub frame: usize,
    /// View of the motion (augmentation).
    pub view: V,
}

/// Factor on the upstream gradient of `later` later frames. It limits the norm `upstream` of that gradient to `later`
/// times the norm `own` of the frame's gradient. Impacts amplify gradients: without a limit, one rollout of hundreds
/// would decide an update.
pub fn join(own: f64, upstream: f64, later: usize) -> f64 {
    (later as f64 * own / upstream.max(1e-300)).min(1.0)
}

/// Ratio of two sums over `count` evenly spaced frames. `one` gives the two terms of a frame from its motion and its
/// number.
pub(super) fn ratio<M>(
    motions: &Trajectories,
    count: usize,
    memory: impl Fn() -> M + Sync + Send,
    one: impl Fn(&mut M, usize, usize) -> (f64, f64) + Sync + Send,
) -> f64 {
    let rows = validation_rows(motions.count * motions.frames, count);
    let one = |memory: &mut M, row: &u64| one(memory, *row as usize / motions.frames, *row as usize % motions.frames);
    let (own, whole): (Vec<f64>, Vec<f64>) = rows.par_iter().map_init(memory, one).unzip();
    own.iter().sum::<f64>() / whole.iter().sum::<f64>().max(1e-300)
}

/// `weight p(e / unit)` with the pseudo-Huber loss `p(e) = sqrt(1 + e^2) - 1`; adds its gradient to `gradient`.
pub(super) fn bent(e: f64, unit: f64, weight: f64, gradient: &mut f64) -> f64 {
    let e = e / unit;
    let length = (1.0 + e * e).sqrt();
    *gradient += weight * e / (length * unit);
    weight * (length - 1.0)
}
