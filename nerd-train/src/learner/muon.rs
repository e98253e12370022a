//! Muon for the hidden matrices (K. Jordan and others, 2024): the update is orthogonalised momentum.
//!
//! `m = 0.95 m + 0.05 g`, `u = 0.95 m + 0.05 g` (Nesterov), `O = NS(u)` and `W -= lr 0.2 sqrt(max(rows, columns)) O`.
//! So an update has about the root mean square of an Adam update, and one learning rate serves both (Liu and others
//! 2025, arXiv 2502.16982). `NS` divides by the Frobenius norm, then iterates `X <- (a 1 + b A + c A^2) X` five times,
//! with `A = X X^T`. This drives all singular values to about 1. All other parameters use Adam. The matrices of query,
//! key and value are orthogonalised one by one.

use std::ops::Range;

use nalgebra::DMatrix;

use crate::prelude::*;

/// Decay of the momentum per update.
pub const MOMENTUM: f32 = 0.95;
/// Number of Newton-Schulz iterations per update.
pub const ITERATIONS: usize = 5;
/// Coefficients a, b, c of a Newton-Schulz iteration.
pub const COEFFICIENTS: [f32; 3] = [3.4445, -4.7750, 2.0315];

/// A hidden matrix in the flat vector, transposed where needed to have at least as many columns as rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hidden {
    /// Offset of the first entry.
    pub offset: usize,
    /// Entries from one row to the next in memory.
    pub stride: usize,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Whether memory holds the transpose: entry (r, c) at `offset + c stride + r` instead of `offset + r stride + c`.
    pub transposed: bool,
}

impl Hidden {
    /// Index of entry (r, c) in the flat vector.
    pub fn at(&self, r: usize, c: usize) -> usize {
        if self.transposed { self.offset + c * self.stride + r } else { self.offset + r * self.stride + c }
    }

    /// Step along the orthogonal update, as a multiple of the learning rate.
    pub fn gain(&self) -> f32 {
        0.2 * (self.columns as f32).sqrt()
    }
}

/// The hidden matrices of a network: `E x E` (query, key, value, projection), then the wider ones of the perceptrons.
pub fn hidden(config: &TransformerConfig) -> [Vec<Hidden>; 2] {
    let e = config.embedding;
    let mut offset = 0;
    let mut square = Vec::new();
    let mut wide = Vec::new();
    for tensor in config.tensors() {
        let columns = tensor.shape.last().copied().unwrap_or(0);
        let parts = (0..columns / e).map(|k| Hidden {
            offset: offset + k * e,
            stride: columns,
            rows: e,
            columns: e,
            transposed: false,
        });
        let whole = Hidden { offset, stride: columns, rows: tensor.shape[0], columns, transposed: false };
        let transposed = Hidden { rows: columns, columns: tensor.shape[0], transposed: true, ..whole };
        let mut path = tensor.name.split('.');
        let place = path.next().unwrap_or("");
        let rest = path.skip(1).join(".");
        match (place, rest.as_str()) {
            ("blocks", "attn.qkv.weight" | "attn.proj.weight") => square.extend(parts),
            ("blocks", "mlp.up.weight") => wide.push(whole),
            // This tensor holds the matrices of gate and value side by side.
            ("blocks", "mlp.gated.weight") => {
                let half = columns / 2;
                wide.extend([0, half].map(|first| Hidden { offset: offset + first, columns: half, ..whole }));
            }
            ("blocks", "mlp.down.weight") => wide.push(transposed),
            _ => {}
        }
        offset += tensor.len();
    }
    [square, wide]
}

/// Ranges of the flat vector outside all hidden matrices.
pub fn others(config: &TransformerConfig) -> Vec<Range<usize>> {
    let mut hidden: Vec<Hidden> = hidden(config).concat();
    hidden.sort_by_key(|h| h.offset);
    // A matrix ends at its last entry. The ranges of query, key and value overlap in `qkv`, so keep the largest end.
    let mut runs = Vec::new();
    let mut end = 0;
    for h in hidden {
        if h.offset > end {
            runs.push(end..h.offset);
        }
        end = end.max(h.at(h.rows - 1, h.columns - 1) + 1);
    }
    runs.push(end..config.parameters());
    runs
}

/// Updates the hidden matrices, their momentum and their average by Muon. `scale` is the clip factor of the gradient;
/// the caller increments `state.step`.
pub(super) fn step(state: &mut LearnerState, (gradient, scale): (&[f32], f32), lr: f32, blend: f32) {
    let all: Vec<Hidden> = hidden(&state.weights.config).concat();
    let m = &state.m;
    // One task per matrix gives the same bits on any number of threads.
    let updates: Vec<(Vec<f32>, DMatrix<f32>)> = all
        .par_iter()
        .map(|h| {
            let clipped = |r, c| gradient[h.at(r, c)] * scale;
            let momentum = |r, c| MOMENTUM * m[h.at(r, c)] + (1.0 - MOMENTUM) * clipped(r, c);
            let ahead = DMatrix::from_fn(h.rows, h.columns, |r, c| {
                MOMENTUM * momentum(r, c) + (1.0 - MOMENTUM) * clipped(r, c)
            });
            let kept = (0..h.rows * h.columns).map(|i| momentum(i / h.columns, i % h.columns)).collect();
            (kept, orthogonal(ahead))
        })
        .collect();
    for (h, (kept, update)) in all.iter().zip(&updates) {
        for (i, momentum) in kept.iter().enumerate() {
            let (r, c) = (i / h.columns, i % h.columns);
            let at = h.at(r, c);
            state.m[at] = *momentum;
            state.weights.flat[at] -= lr * h.gain() * update[(r, c)];
            state.average[at] += blend * (state.weights.flat[at] - state.average[at]);
        }
    }
}

/// An approximation of the nearest matrix with orthonormal rows. Singular values of the result lie between about 0.7
/// and 1.2.
pub fn orthogonal(mut x: DMatrix<f32>) -> DMatrix<f32> {
    let [a, b, c] = COEFFICIENTS;
    x /= x.norm() + 1e-7;
    for _ in 0..ITERATIONS {
        let gram = &x * x.transpose();
        let mut p = &gram * &gram * c + &gram * b;
        for i in 0..p.nrows() {
            p[(i, i)] += a;
        }
        x = p * x;
    }
    x
}
