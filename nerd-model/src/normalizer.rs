//! Mean and variance of inputs and targets over the training set, once, before training.
//!
//! Inputs become `(x - mean) / sqrt(var + 1e-5)`, outputs are multiplied back. The statistics run over every token
//! of every window of h tokens, so a token inside a trajectory counts as often as windows hold it (up to h times).

use serde::{Deserialize, Serialize};

const EPSILON: f64 = 1e-5;

/// Scale of a coordinate of this variance.
pub(crate) fn scale(variance: f64) -> f64 {
    (variance + EPSILON).sqrt()
}

/// Per-coordinate shift and scale of one block of numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moments {
    /// Mean.
    pub mean: Vec<f64>,
    /// Population variance.
    pub variance: Vec<f64>,
}

impl Moments {
    /// Moments of rows `[trajectory][frame][width]`, each weighted by the windows of `history` tokens that hold it.
    pub fn of(rows: &[f32], width: usize, frames: usize, history: usize) -> Self {
        let (mut total, mut mean, mut square) = (0.0, vec![0.0; width], vec![0.0; width]);
        for (i, row) in rows.chunks_exact(width).enumerate() {
            let f = i % frames;
            let weight = (f + 1).min(frames - f).min(history).min(frames + 1 - history) as f64;
            total += weight;
            // West's update: stable at millions of rows.
            for ((m, s), x) in mean.iter_mut().zip(&mut square).zip(row) {
                let gap = f64::from(*x) - *m;
                *m += gap * weight / total;
                *s += weight * gap * (f64::from(*x) - *m);
            }
        }
        Self { mean, variance: square.iter().map(|s| s / f64::max(total, 1.0)).collect() }
    }

    /// Moments that leave rows of `width` as they are.
    pub fn identity(width: usize) -> Self {
        Self { mean: vec![0.0; width], variance: vec![1.0 - EPSILON; width] }
    }

    /// Scale `sqrt(var + 1e-5)` by coordinate.
    pub fn scale(&self) -> Vec<f64> {
        self.variance.iter().map(|v| scale(*v)).collect()
    }

    /// Normalises rows in place.
    pub fn normalize(&self, rows: &mut [f32]) {
        let scale = self.scale();
        for row in rows.chunks_exact_mut(self.mean.len()) {
            for ((x, m), s) in row.iter_mut().zip(&self.mean).zip(&scale) {
                *x = ((f64::from(*x) - m) / s) as f32;
            }
        }
    }
}

/// Moments of inputs and targets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalizer {
    /// Of tokens.
    pub inputs: Moments,
    /// Of targets.
    pub outputs: Moments,
}
