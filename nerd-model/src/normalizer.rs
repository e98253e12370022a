//! Mean and variance of tokens and targets over the training set, computed once before training.
//!
//! Inputs become `(x - mean) / sqrt(var + epsilon)`, outputs are scaled back. The statistics run over all windows of h
//! tokens, so a token inside a trajectory counts up to h times.
//!
//! The paper's epsilon of 1e-5 is absolute. A target whose standard deviation is below 3e-3 of its unit has less weight
//! in the loss. So each run chooses its epsilon, which is stored with the moments.

use serde::{Deserialize, Serialize};

/// The paper's epsilon, and the default in files.
pub const EPSILON: f64 = 1e-5;

fn paper() -> f64 {
    EPSILON
}

fn is_paper(epsilon: &f64) -> bool {
    *epsilon == EPSILON
}

/// Mean and variance of each coordinate of rows, for their shift and scale.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moments {
    /// Mean of each coordinate, `[width]`.
    pub mean: Vec<f64>,
    /// Population variance of each coordinate, `[width]`.
    pub variance: Vec<f64>,
    /// Added to the variance, above 0: the scale of a coordinate is `sqrt(variance + epsilon)`.
    #[serde(default = "paper", skip_serializing_if = "is_paper")]
    pub epsilon: f64,
}

impl Moments {
    /// Moments of rows `[trajectory][frame][width]`, each weighted by the number of windows of `history` tokens that
    /// contain it.
    pub fn of(rows: &[f32], width: usize, frames: usize, history: usize) -> Self {
        let mut total = 0.0;
        let mut mean = vec![0.0; width];
        let mut square = vec![0.0; width];
        for (i, row) in rows.chunks_exact(width).enumerate() {
            let f = i % frames;
            let weight = (f + 1).min(frames - f).min(history).min(frames + 1 - history) as f64;
            total += weight;
            // West's update, stable over millions of rows.
            for ((m, s), x) in mean.iter_mut().zip(&mut square).zip(row) {
                let gap = f64::from(*x) - *m;
                *m += gap * weight / total;
                *s += weight * gap * (f64::from(*x) - *m);
            }
        }
        Self { mean, variance: square.iter().map(|s| s / f64::max(total, 1.0)).collect(), epsilon: EPSILON }
    }

    /// Moments whose shift and scale leave rows of `width` numbers unchanged.
    pub fn identity(width: usize) -> Self {
        Self { mean: vec![0.0; width], variance: vec![1.0 - EPSILON; width], epsilon: EPSILON }
    }

    /// Scale `sqrt(variance + epsilon)` of each coordinate.
    pub fn scale(&self) -> impl Iterator<Item = f64> {
        self.variance.iter().map(|v| (v + self.epsilon).sqrt())
    }

    /// Normalises rows `[..][width]` in place.
    pub fn normalize(&self, rows: &mut [f32]) {
        let scale: Vec<f64> = self.scale().collect();
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
    /// Moments of tokens.
    pub inputs: Moments,
    /// Moments of targets.
    pub outputs: Moments,
}
