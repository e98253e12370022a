//! The optimiser on flat vectors: global-norm clip, Adam, moving average of the weights.
//!
//! With t = s + 1 the update counted from 1 and g the clipped gradient,
//! `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`, `w -= lr (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)`,
//! then `a += blend (w - a)`. Entries are independent, so the result does not depend on the number of threads.

use rayon::prelude::*;

use super::{LearnerConfig, LearnerState, Optimizer, muon};

const BETA: (f32, f32) = (0.9, 0.999);
const EPSILON: f32 = 1e-8;
/// Entries one task handles: four vectors of this length fit in a second-level cache.
const CHUNK: usize = 1 << 14;

/// Global norm `|g|`, summed in f64.
pub fn norm(gradient: &[f32]) -> f32 {
    // Partial sums over fixed chunks, added in order: the same bits on any number of threads.
    let parts: Vec<f64> = gradient.par_chunks(CHUNK).map(|c| c.iter().map(|&g| f64::from(g) * f64::from(g)).sum()).collect();
    parts.iter().sum::<f64>().sqrt() as f32
}

/// Clips `gradient` (of norm `norm`) to `config.clip`, makes one update of `state` and counts it: Adam for all
/// entries, or for those that Muon leaves.
///
/// # Panics
/// If `gradient` is shorter than the weights.
pub fn step(state: &mut LearnerState, gradient: &[f32], norm: f32, lr: f32, config: &LearnerConfig) {
    step_by(BETA, state, gradient, norm, lr, config);
}

/// [`step`] with other betas.
///
/// # Panics
/// As it does.
pub fn step_by(beta: (f32, f32), state: &mut LearnerState, gradient: &[f32], norm: f32, lr: f32, config: &LearnerConfig) {
    let scale = (config.clip / (norm + 1e-6)).min(1.0);
    let t = (state.step + 1) as f64;
    let corrections = (1.0 - f64::from(beta.0).powf(t), 1.0 - f64::from(beta.1).powf(t));
    let (rate, inverse_root) = ((f64::from(lr) / corrections.0) as f32, corrections.1.powf(-0.5) as f32);
    let blend = super::blend(config.average, state.step);
    assert!(gradient.len() >= state.weights.flat.len(), "one gradient entry for each weight");
    let clipped: Vec<f32> = gradient.par_iter().map(|g| g * scale).collect();
    let mine = match config.optimizer {
        Optimizer::Adam => Vec::from([std::ops::Range { start: 0, end: state.weights.flat.len() }]),
        Optimizer::Muon => {
            muon::step(state, &clipped, lr, config);
            muon::others(&state.weights.config)
        }
    };
    for range in mine {
        state.weights.flat[range.clone()]
            .par_chunks_mut(CHUNK)
            .zip(state.m[range.clone()].par_chunks_mut(CHUNK))
            .zip(state.v[range.clone()].par_chunks_mut(CHUNK))
            .zip(state.average[range.clone()].par_chunks_mut(CHUNK))
            .zip(clipped[range].par_chunks(CHUNK))
            .for_each(|((((w, m), v), a), g)| {
                for ((((w, m), v), a), g) in w.iter_mut().zip(m).zip(v).zip(a).zip(g) {
                    *m = beta.0 * *m + (1.0 - beta.0) * g;
                    *v = beta.1 * *v + (1.0 - beta.1) * g * g;
                    *w -= rate * *m / (v.sqrt() * inverse_root + EPSILON);
                    *a += blend * (*w - *a);
                }
            });
    }
    state.step += 1;
}
