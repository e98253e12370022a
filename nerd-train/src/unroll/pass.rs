//! Rollouts through H frames and the gradient of their loss: backpropagation through time.

use super::*;

/// A predicted state along a motion.
#[derive(Clone)]
pub struct Rollout<B: Body> {
    /// Present frame of the motion.
    pub place: Place<B::View>,
    /// Predicted state before that frame, in the view of `place`.
    pub state: B::State,
}

/// Inputs of a forward and backward pass over rollouts.
pub struct Unroll<'a, B> {
    /// Motions, system and length of rollouts.
    pub course: &'a Course<B>,
    /// Network with the weights of the update.
    pub network: &'a Loaded,
}

/// Records of a frame for the backward pass.
struct Kept<B: Body> {
    before: Vec<B::State>,
    looks: Vec<B::Look>,
    outputs: Vec<f32>,
    /// Gradients of the frame's loss with respect to the states after the frame.
    slopes: Vec<B::Slope>,
}

impl<B: Body> Unroll<'_, B> {
    /// A rollout that starts from the truth.
    pub fn begin(&self, place: Place<B::View>) -> Rollout<B> {
        Rollout { place, state: self.course.body.truth(&self.course.train, &place) }
    }

    /// Steps rollouts through H frames. Returns the sum of their losses times `weight`, and the gradient of this sum
    /// with respect to the network's weights. `memory` holds the network's activations by frame.
    pub fn pass(&self, rollouts: &mut [Rollout<B>], weight: f64, memory: &mut Vec<Memory>) -> (f64, Vec<f32>) {
        let frames = self.course.frames;
        let mut own = self.course.body.memory();
        memory.resize_with(frames.max(memory.len()), Memory::default);
        let mut total = 0.0;
        let kept = (0..frames)
            .map(|k| self.forward(k, rollouts, weight, (&mut own, &mut memory[k]), &mut total))
            .collect_vec();
        let mut gradient: Vec<f32> = Vec::new();
        let mut upstream: Vec<B::Slope> = Vec::new();
        for (k, kept) in kept.into_iter().enumerate().rev() {
            upstream = self.backward(&kept, (&upstream, frames - 1 - k), (&mut own, &mut memory[k]), &mut gradient);
        }
        (total, gradient)
    }

    fn forward(
        &self,
        k: usize,
        rollouts: &mut [Rollout<B>],
        weight: f64,
        (own, memory): (&mut B::Memory, &mut Memory),
        total: &mut f64,
    ) -> Kept<B> {
        let Course { body, train, .. } = self.course;
        let mut tokens = Vec::new();
        let looks = rollouts.iter().map(|r| body.look(&r.state, (train, &r.place), own, &mut tokens)).collect_vec();
        let outputs = self.network.forward(&tokens, memory, Pass::Kept(body.tokens())).clone();
        let mut before = Vec::with_capacity(rollouts.len());
        let mut slopes = Vec::with_capacity(rollouts.len());
        let rows = outputs.chunks_exact(outputs.len() / rollouts.len().max(1));
        for (r, look, row) in izip!(rollouts, &looks, rows) {
            let after = body.advance(&r.state, look, row, own);
            r.place.frame += 1;
            let truth = body.truth(train, &r.place);
            let mut slope = body.level();
            *total += body.loss([&after, &truth], k + 1, weight, &mut slope);
            before.push(std::mem::replace(&mut r.state, after));
            slopes.push(slope);
        }
        Kept { before, looks, outputs, slopes }
    }

    /// Gradients with respect to the states before a frame, from the upstream gradients of `later` later frames. The
    /// upstream gradients of the last frame are empty. Adds the gradient with respect to the weights to `gradient`.
    fn backward(
        &self,
        kept: &Kept<B>,
        (upstream, later): (&[B::Slope], usize),
        (own, memory): (&mut B::Memory, &mut Memory),
        gradient: &mut Vec<f32>,
    ) -> Vec<B::Slope> {
        let body = &self.course.body;
        let count = kept.before.len();
        let mut all = kept.slopes.clone();
        let mut slopes = Vec::with_capacity(count);
        let mut by_outputs = Vec::new();
        all.iter_mut().zip(upstream).for_each(|(own, upstream)| body.join(own, upstream, later));
        let rows = kept.outputs.chunks_exact(kept.outputs.len() / count);
        for (before, row, upstream) in izip!(&kept.before, rows, &all) {
            let mut slope = body.level();
            by_outputs.extend(body.advance_back(before, row, upstream, &mut slope));
            slopes.push(slope);
        }
        let (by_weights, by_tokens) = self.network.backward(body.tokens(), &by_outputs, memory, true);
        match gradient.is_empty() {
            true => *gradient = by_weights,
            false => add(gradient, &by_weights),
        }
        let rows = by_tokens.chunks_exact(by_tokens.len() / count);
        for (before, look, upstream, row, slope) in izip!(&kept.before, &kept.looks, &all, rows, &mut slopes) {
            body.look_back(before, look, row, upstream, slope, own);
        }
        slopes
    }
}
