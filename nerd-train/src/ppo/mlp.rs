//! A perceptron over rows, forward and backward, on faer's products.
//!
//! With weights `W_l [in, out]` and biases b_l, `x_{l+1} = f(x_l W_l + b_l)`, f nothing in the last layer. Parameters are one
//! flat vector, W then b by layer. Backward, with D the gradient behind a layer: `dW += x^T D`, `db += sum of rows of D`,
//! in front of it `D W^T`, times the slope of f.

use faer::Accum;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::activation::Activation;
use nerd_model::program::cpu::product::{matrix, product};

/// Shape of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mlp {
    /// Widths from input to output.
    pub sizes: Vec<usize>,
    /// Between two layers.
    pub activation: Activation,
}

/// Activations of one pass, reused by the next.
#[derive(Default)]
pub struct Tape {
    /// Rows that go into each layer, `[rows][in]`; the last are the outputs.
    pub layers: Vec<Vec<f32>>,
    /// Gradient behind the layer at hand; the caller's to fill, `[rows][outputs]`.
    pub gradient: Vec<f32>,
    before: Vec<f32>,
}

impl Mlp {
    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.sizes.windows(2).map(|w| (w[0] + 1) * w[1]).sum()
    }

    /// Weights from `U(-1, 1) / sqrt(in)`, biases 0.
    pub fn init(&self, rng: &mut ChaCha8Rng) -> Vec<f32> {
        let mut flat = Vec::with_capacity(self.parameters());
        for w in self.sizes.windows(2) {
            let bound = (w[0] as f32).sqrt().recip();
            flat.extend((0..w[0] * w[1]).map(|_| (2.0 * rng.random::<f32>() - 1.0) * bound));
            flat.extend(std::iter::repeat_n(0.0, w[1]));
        }
        flat
    }

    /// Outputs `[rows][outputs]` for the rows in `tape.layers[0]`.
    pub fn forward<'a>(&self, flat: &[f32], tape: &'a mut Tape) -> &'a [f32] {
        let last = self.sizes.len() - 1;
        tape.layers.resize_with(last + 1, Vec::new);
        let (rows, mut rest) = (tape.layers[0].len() / self.sizes[0], flat);
        for (l, w) in self.sizes.windows(2).enumerate() {
            let (weights, behind) = rest.split_at(w[0] * w[1]);
            let (bias, behind) = behind.split_at(w[1]);
            rest = behind;
            let (below, above) = tape.layers.split_at_mut(l + 1);
            let (x, y) = (&below[l], &mut above[0]);
            y.clear();
            (0..rows).for_each(|_| y.extend_from_slice(bias));
            product(y, Accum::Add, matrix(x, rows, w[0]), matrix(weights, w[0], w[1]));
            if l + 1 < last {
                self.activation.apply(y);
            }
        }
        &tape.layers[last]
    }

    /// Adds to `gradient` that of the pass on `tape`, whose `gradient` holds that of the outputs.
    pub fn backward(&self, flat: &[f32], tape: &mut Tape, gradient: &mut [f32]) {
        let rows = tape.layers[0].len() / self.sizes[0];
        let (mut end, Tape { layers, gradient: behind, before }) = (self.parameters(), tape);
        for (l, w) in self.sizes.windows(2).enumerate().rev() {
            let start = end - (w[0] + 1) * w[1];
            let (d_weights, d_bias) = gradient[start..end].split_at_mut(w[0] * w[1]);
            behind.chunks_exact(w[1]).for_each(|row| d_bias.iter_mut().zip(row).for_each(|(d, g)| *d += g));
            product(d_weights, Accum::Add, matrix(&layers[l], rows, w[0]).transpose(), matrix(behind, rows, w[1]));
            if l > 0 {
                before.clear();
                before.resize(rows * w[0], 0.0);
                let weights = matrix(&flat[start..start + w[0] * w[1]], w[0], w[1]);
                product(before, Accum::Add, matrix(behind, rows, w[1]), weights.transpose());
                self.activation.chain(&layers[l], before);
                std::mem::swap(behind, before);
            }
            end = start;
        }
    }
}
