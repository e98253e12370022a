//! Rollouts through H frames and the gradient of their loss: back-propagation through time.

use nerd_model::chain::{Chain, Look, OUTPUTS, Outputs, Rods};
use nerd_model::program::cpu::{Loaded, Memory, Pass};

use super::course::Course;
use super::view::View;

/// A chain on its way along a motion.
#[derive(Clone)]
pub struct Rollout {
    /// Which motion.
    pub motion: usize,
    /// Frame that it begins with.
    pub frame: usize,
    /// From where it is seen.
    pub view: View,
    /// Where it is, as it is seen.
    pub rods: Rods,
}

/// What rollouts go through.
pub struct Unroll<'a> {
    /// Of which chain.
    pub chain: &'a Chain,
    /// What they should do.
    pub course: &'a Course,
    /// With the weights of the update.
    pub network: &'a Loaded,
}

/// What the way back needs of a frame.
struct Kept {
    before: Vec<Rods>,
    looks: Vec<Look>,
    outputs: Vec<f32>,
    /// Of the frame's loss, by the rollouts after it.
    slopes: Vec<Rods>,
}

impl Unroll<'_> {
    /// A rollout that begins on the truth.
    pub fn begin(&self, motion: usize, frame: usize, view: View) -> Rollout {
        Rollout { motion, frame, view, rods: self.truth(motion, frame, &view) }
    }

    fn truth(&self, motion: usize, frame: usize, view: &View) -> Rods {
        view.rods(self.chain, &self.chain.rods(self.course.train.state(motion, frame)))
    }

    /// Moves rollouts through H frames; the sum of their losses times `weight` and its gradient by the weights. `memory` holds the
    /// network's activations by frame.
    pub fn pass(&self, rollouts: &mut [Rollout], weight: f64, memory: &mut Vec<Memory>) -> (f64, Vec<f32>) {
        memory.resize_with(self.course.frames.max(memory.len()), Memory::default);
        let mut total = 0.0;
        let kept: Vec<Kept> = (0..self.course.frames).map(|k| self.forward(k, rollouts, weight, &mut memory[k], &mut total)).collect();
        let mut gradient: Vec<f32> = Vec::new();
        let mut upstream: Vec<Rods> = Vec::new();
        for (k, kept) in kept.into_iter().enumerate().rev() {
            upstream = self.backward(&kept, (&upstream, self.course.frames - 1 - k), &mut memory[k], &mut gradient);
        }
        (total, gradient)
    }

    fn forward(&self, k: usize, rollouts: &mut [Rollout], weight: f64, memory: &mut Memory, total: &mut f64) -> Kept {
        let chain = self.chain;
        let look = |r: &Rollout| {
            let torques = r.view.torques(chain, self.course.train.torques(r.motion, r.frame));
            let scene = &self.course.train.scenes[r.motion];
            Look::at(chain, &r.rods, &torques, |place| r.view.contact(chain, scene, place))
        };
        let looks: Vec<Look> = rollouts.iter().map(look).collect();
        let mut tokens = Vec::new();
        rollouts.iter().zip(&looks).for_each(|(r, look)| look.tokens(chain, &r.rods, &mut tokens));
        let outputs = self.network.forward(&tokens, memory, Pass::Kept(chain.rods)).clone();
        let (mut before, mut slopes) = (Vec::with_capacity(rollouts.len()), Vec::with_capacity(rollouts.len()));
        for ((r, look), numbers) in rollouts.iter_mut().zip(&looks).zip(outputs.chunks_exact(chain.rods * OUTPUTS)) {
            let after = chain.advance(&r.rods, &look.glided, Outputs { numbers, scale: &self.course.scale });
            r.frame += 1;
            let (truth, mut slope) = (self.truth(r.motion, r.frame, &r.view), Rods::zeros(chain.rods));
            *total += self.course.loss().of(chain, (&after, &truth), k + 1, weight, &mut slope);
            before.push(std::mem::replace(&mut r.rods, after));
            slopes.push(slope);
        }
        Kept { before, looks, outputs, slopes }
    }

    /// Gradients by the rollouts before a frame from the upstream ones of so many later frames; none after the last.
    fn backward(&self, kept: &Kept, (upstream, later): (&[Rods], usize), memory: &mut Memory, gradient: &mut Vec<f32>) -> Vec<Rods> {
        let (chain, width) = (self.chain, self.chain.rods * OUTPUTS);
        let (mut all, mut slopes, mut by_outputs) = (kept.slopes.clone(), Vec::with_capacity(kept.before.len()), Vec::new());
        all.iter_mut().zip(upstream).for_each(|(own, upstream)| join(own, upstream, later));
        for ((before, numbers), upstream) in kept.before.iter().zip(kept.outputs.chunks_exact(width)).zip(&all) {
            let mut slope = Rods::zeros(chain.rods);
            by_outputs.extend(chain.advance_back(before, Outputs { numbers, scale: &self.course.scale }, upstream, &mut slope));
            slopes.push(slope);
        }
        let (by_weights, by_tokens) = self.network.backward(chain.rods, &by_outputs, memory, true);
        match gradient.is_empty() {
            true => *gradient = by_weights,
            false => gradient.iter_mut().zip(&by_weights).for_each(|(g, w)| *g += w),
        }
        let tokens = by_tokens.chunks_exact(by_tokens.len() / kept.before.len());
        for ((((before, look), upstream), tokens), slope) in kept.before.iter().zip(&kept.looks).zip(&all).zip(tokens).zip(&mut slopes) {
            frame_back(chain, look, before, tokens, upstream, slope);
        }
        slopes
    }
}

/// Adds to `slope` what comes to the rods before a frame through their tokens, from the gradients by these, and through the gripper's glide.
pub fn frame_back(chain: &Chain, look: &Look, before: &Rods, by_tokens: &[f32], upstream: &Rods, slope: &mut Rods) {
    let mut glided = look.tokens_back(chain, before, by_tokens, slope);
    glided.numbers_mut().zip(upstream.gripper.numbers()).for_each(|(x, g)| *x += g);
    let led = chain.glide_back(&glided);
    slope.gripper.numbers_mut().zip(led.numbers()).for_each(|(x, g)| *x += g);
}

/// Adds upstream gradients of so many later frames to its own: at most as much as if each of them were as large as its own. Where a rod
/// strikes, a frame stretches what comes into it, and without that one rollout of hundreds would decide an update.
pub fn join(own: &mut Rods, upstream: &Rods, later: usize) {
    let norm = |rods: &Rods| (square(rods.gripper.numbers()) + square(rods.along.iter().chain(&rods.rates).flatten().copied())).sqrt();
    let share = (later as f64 * norm(own) / norm(upstream).max(1e-300)).min(1.0);
    own.gripper.numbers_mut().zip(upstream.gripper.numbers()).for_each(|(x, y)| *x += share * y);
    let pairs = own.along.iter_mut().chain(&mut own.rates).zip(upstream.along.iter().chain(&upstream.rates));
    pairs.for_each(|(x, y)| *x += y * share);
}

fn square(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|x| x * x).sum()
}
