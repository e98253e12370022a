//! What is rolled out.

use super::*;

/// How states are seen by a network, moved by its outputs and judged, with the way back of each: vector-Jacobian products by hand.
pub trait Body: Clone + Send + Sync {
    /// From where a motion is seen.
    type View: Copy + Send + Sync;
    /// As the network moves it.
    type State: Clone + Send + Sync;
    /// A gradient by it.
    type Slope: Clone + Send + Sync;
    /// What the way back of a frame needs beside the state before it.
    type Look: Send;
    /// Working memory of a thread.
    type Memory;

    /// Of a thread.
    fn memory(&self) -> Self::Memory;
    /// Tokens of a state.
    fn tokens(&self) -> usize;
    /// Of two draws: a turn (rad), and whether it is mirrored.
    fn view(&self, yaw: f64, mirrored: bool) -> Self::View;
    /// A recorded state.
    fn truth(&self, motions: &Motions, place: &Place<Self::View>) -> Self::State;
    /// Looks at a state in a place of a motion; its normalised tokens go onto `tokens`.
    fn look(&self, state: &Self::State, at: (&Motions, &Place<Self::View>), memory: &mut Self::Memory, tokens: &mut Vec<f32>)
    -> Self::Look;
    /// The state after the frame, by the network's normalised outputs.
    fn advance(&self, before: &Self::State, look: &Self::Look, outputs: &[f32], memory: &mut Self::Memory) -> Self::State;
    /// A gradient of zeros.
    fn level(&self) -> Self::Slope;
    /// The loss of a predicted state and the truth in the k-th frame, k from 1, times `weight`; its gradient is added to `slope`.
    fn loss(&self, pair: [&Self::State; 2], k: usize, weight: f64, slope: &mut Self::Slope) -> f64;
    /// Adds upstream gradients of `later` later frames to the frame's own.
    fn join(&self, own: &mut Self::Slope, upstream: &Self::Slope, later: usize);
    /// Gradients by the outputs from the `upstream` one by the state after the frame; what comes directly to the state before it is added
    /// to `slope`.
    fn advance_back(&self, before: &Self::State, outputs: &[f32], upstream: &Self::Slope, slope: &mut Self::Slope) -> Vec<f32>;
    /// Adds to `slope` what comes to the state before a frame through what was seen of it: from gradients by its tokens, and from the
    /// `upstream` one.
    fn look_back(
        &self,
        before: &Self::State,
        look: &Self::Look,
        by_tokens: &[f32],
        upstream: &Self::Slope,
        slope: &mut Self::Slope,
        memory: &mut Self::Memory,
    );
    /// Whether a rollout is near enough to the truth to go on from where an update ended, so that a network learns from its own states.
    fn near(&self, state: &Self::State, truth: &Self::State) -> bool;
    /// A network's relative error in the change over single frames, over `frames` evenly spaced frames.
    fn missed(&self, motions: &Motions, network: &Loaded, frames: usize) -> f64;
}

/// A frame of a motion.
#[derive(Clone, Copy, Debug)]
pub struct Place<V> {
    /// Which motion.
    pub motion: usize,
    /// Frames from its start.
    pub frame: usize,
    /// From where it is seen.
    pub view: V,
}

/// The factor on upstream gradients of `later` frames, of this norm, beside own gradients of norm `own`: they count at most as if each of
/// them were as large as its own. Where something strikes, a frame stretches what comes into it, and without that one rollout of hundreds
/// would decide an update.
pub fn join(own: f64, upstream: f64, later: usize) -> f64 {
    (later as f64 * own / upstream.max(1e-300)).min(1.0)
}

/// `weight p(e / unit)` with `p(e) = sqrt(1 + e^2) - 1`, its gradient added.
pub(super) fn bent(e: f64, unit: f64, weight: f64, slope: &mut f64) -> f64 {
    let e = e / unit;
    let length = (1.0 + e * e).sqrt();
    *slope += weight * e / (length * unit);
    weight * (length - 1.0)
}
