//! Adam on flat vectors, with global-norm clipping and a moving average of the weights; for training and PPO.
//!
//! With t the update counted from 1 and g the clipped gradient,
//! `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`, `w -= lr (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)`,
//! then `a += blend (w - a)`. Entries are independent, so the result does not depend on the number of threads.

use super::muon;
use crate::prelude::*;

/// Adam's betas in training.
pub const BETA: [f64; 2] = [0.9f32 as f64, 0.999f32 as f64];
const EPSILON: f32 = 1e-8;
/// Entries of a vector in one parallel task. Four vectors of this length fit in a level-2 cache.
const CHUNK: usize = 1 << 14;

/// Global norm `|g|`, summed in f64.
pub fn norm(gradient: &[f32]) -> f32 {
    // Partial sums over fixed chunks are added in order, so the bits do not depend on the number of threads.
    let parts: Vec<f64> =
        gradient.par_chunks(CHUNK).map(|c| c.iter().map(|&g| f64::from(g) * f64::from(g)).sum()).collect();
    parts.iter().sum::<f64>().sqrt() as f32
}

/// Weight of the new weights in the moving average after update `step`, counted from 0. In update s the average's decay
/// d is `(1 + s) / (10 + s)` while that is below `average`. From then on only every sixteenth update changes the
/// average, by the decay of sixteen updates. The reason is rounding: in f32 an average a stops once `blend |w - a|` is
/// below half a unit in the last place of a. With d = 0.9999 in every update, a would stop 6e-4 of the weight short of
/// w, too far for a well-trained network.
pub fn blend(average: f64, step: u64) -> f32 {
    let growing = (1.0 + step as f64) / (10.0 + step as f64);
    match (step + 1) % 16 {
        _ if growing < average => (1.0 - growing) as f32,
        0 => (1.0 - average.powi(16)) as f32,
        _ => 0.0,
    }
}

pub(crate) struct Adam {
    decay: [f32; 2],
    gain: [f32; 2],
    rate: f32,
    root: f32,
    scale: f32,
}

impl Adam {
    /// Update `t`, counted from 1, with a gradient of norm `norm` that is clipped to `most`.
    pub fn new(beta: [f64; 2], t: u64, rate: f64, norm: f32, most: f32) -> Self {
        let corrections = beta.map(|b| 1.0 - b.powf(t as f64));
        Self {
            decay: beta.map(|b| b as f32),
            gain: beta.map(|b| (1.0 - b) as f32),
            rate: (rate / corrections[0]) as f32,
            root: corrections[1].powf(-0.5) as f32,
            scale: clip(norm, most),
        }
    }

    pub fn step(&self, [w, m, v]: [&mut [f32]; 3], gradient: &[f32]) {
        let Self { decay, gain, rate, root, scale } = *self;
        for (w, m, v, g) in izip!(w, m, v, gradient) {
            let g = g * scale;
            *m = decay[0] * *m + gain[0] * g;
            *v = decay[1] * *v + gain[1] * g * g;
            *w -= rate * *m / (v.sqrt() * root + EPSILON);
        }
    }
}

fn clip(norm: f32, most: f32) -> f32 {
    (most / (norm + 1e-6)).min(1.0)
}

pub(crate) struct Optimiser {
    pub config: LearnerConfig,
    pub state: LearnerState,
    beta: [f64; 2],
    /// Sums of losses and gradient norms since the last report, and the number of updates.
    sums: (f64, f64, u32),
}

impl Optimiser {
    pub fn new(config: LearnerConfig, state: LearnerState, beta: [f64; 2]) -> Self {
        Self { config, state, beta, sums: (0.0, 0.0, 0) }
    }

    /// Makes one update, and counts it.
    pub fn update(&mut self, lr: f32, loss: f32, gradient: &[f32]) -> LearnResult {
        let norm = norm(gradient);
        if !loss.is_finite() || !norm.is_finite() {
            let loss = if loss.is_finite() { f32::NAN } else { loss };
            return Err(LearnError::NotFinite { step: self.state.step, loss });
        }
        step(self.beta, &mut self.state, gradient, norm, lr, &self.config);
        self.sums = (self.sums.0 + f64::from(loss), self.sums.1 + f64::from(norm), self.sums.2 + 1);
        Ok(())
    }

    pub fn progress(&mut self) -> Progress {
        let (loss, norm, n) = std::mem::take(&mut self.sums);
        let n = f64::from(n.max(1));
        Progress { loss: (loss / n) as f32, gradient_norm: (norm / n) as f32 }
    }
}

/// Clips `gradient` (of norm `norm`) to `config.clip`, makes one update of `state` and counts it. Adam updates all
/// entries, or with Muon all entries outside hidden matrices.
///
/// # Panics
/// If `gradient` is shorter than the weights.
pub fn step(beta: [f64; 2], state: &mut LearnerState, gradient: &[f32], norm: f32, lr: f32, config: &LearnerConfig) {
    let adam = Adam::new(beta, state.step + 1, lr.into(), norm, config.clip);
    let blend = blend(config.average, state.step);
    assert!(gradient.len() >= state.weights.flat.len(), "one gradient entry for each weight");
    let mine = match config.optimizer {
        Optimizer::Adam => std::iter::once(0..state.weights.flat.len()).collect(),
        Optimizer::Muon => {
            muon::step(state, (gradient, adam.scale), lr, blend);
            muon::others(&state.weights.config)
        }
    };
    for range in mine {
        let weights = state.weights.flat[range.clone()].par_chunks_mut(CHUNK);
        let moments = state.m[range.clone()].par_chunks_mut(CHUNK).zip(state.v[range.clone()].par_chunks_mut(CHUNK));
        let averages = state.average[range.clone()].par_chunks_mut(CHUNK);
        weights.zip(moments).zip(averages).zip(gradient[range].par_chunks(CHUNK)).for_each(|(((w, (m, v)), a), g)| {
            adam.step([&mut *w, m, v], g);
            a.iter_mut().zip(&*w).for_each(|(a, w)| *a += blend * (w - *a));
        });
    }
    state.step += 1;
}
