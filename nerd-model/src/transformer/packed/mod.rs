//! Networks on the CPU without a tensor framework: faer's matrix products, everything else fused around them.
//!
//! LayerNorm weights are folded into the matrices behind them (`diag(w) W`), element-wise work runs with the widest
//! vectors the processor has, and rows are cut into blocks whose activations stay in the second-level cache, one block to
//! a thread at a time. Equal to the burn module to rounding.

mod stream;
mod window;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::config::{Positions, TransformerConfig};
use super::elementwise::{gelu, normalize, relu};
use super::stream::{Stream, Windowed};
use super::weights::Weights;

pub use stream::PackedStream;
pub use window::PackedForward;

/// The CPU engine for a network: remembering if its positions allow it, or else recomputing windows.
pub fn packed(weights: &Weights) -> Box<dyn Stream> {
    match weights.config.positions {
        Positions::Table => Box::new(Windowed::new(PackedForward::new(weights), weights.config)),
        Positions::Rotary => Box::new(PackedStream::new(weights)),
    }
}

/// Rows (tokens) of a block.
const ROWS: usize = 320;

/// A network's matrices, `[in, out]` row-major.
struct Packed {
    config: TransformerConfig,
    embed: Vec<f32>,
    /// What is added to an embedded token, by its place: position row plus bias; of rotary positions the bias alone.
    place: Vec<f32>,
    blocks: Vec<Block>,
    out: Vec<f32>,
    hidden: Vec<f32>,
    hidden_bias: Vec<f32>,
    head: Vec<f32>,
    head_bias: Vec<f32>,
}

/// Matrices of one block.
struct Block {
    qkv: Vec<f32>,
    proj: Vec<f32>,
    up: Vec<f32>,
    down: Vec<f32>,
}

/// Activations of one thread.
#[derive(Default)]
struct Memory {
    x: Vec<f32>,
    normed: Vec<f32>,
    qkv: Vec<f32>,
    mixed: Vec<f32>,
    wide: Vec<f32>,
    newest: Vec<f32>,
    scores: Vec<f32>,
    turned: Vec<f32>,
}

impl Packed {
    fn new(weights: &Weights) -> Self {
        let c = weights.config;
        let mut tensors = weights.iter().map(|(_, _, values)| values.to_vec());
        let mut next = || tensors.next().unwrap_or_default();
        let folded = |norm: Vec<f32>, mut matrix: Vec<f32>| {
            let width = matrix.len() / norm.len();
            matrix.chunks_exact_mut(width).zip(norm).for_each(|(row, w)| row.iter_mut().for_each(|x| *x *= w));
            matrix
        };
        let (embed, bias) = (next(), next());
        let place = match c.positions {
            Positions::Table => next().chunks_exact(c.embedding).flat_map(|row| row.iter().zip(&bias).map(|(p, b)| p + b)).collect(),
            Positions::Rotary => bias,
        };
        let mut blocks = Vec::new();
        for _ in 0..c.layers {
            let (norm, qkv, proj) = (next(), next(), next());
            let (norm_mlp, up, down) = (next(), next(), next());
            blocks.push(Block { qkv: folded(norm, qkv), proj, up: folded(norm_mlp, up), down });
        }
        let out = folded(next(), next());
        let (hidden, hidden_bias, head, head_bias) = (next(), next(), next(), next());
        Self { config: c, embed, place, blocks, out, hidden, hidden_bias, head, head_bias }
    }

    /// From rows `[n, E]` behind the last block to predictions `[n, outputs]`.
    fn top(&self, x: &[f32], normed: &mut Vec<f32>, mixed: &mut Vec<f32>, wide: &mut Vec<f32>, out: &mut [f32]) {
        let TransformerConfig { embedding: e, head, outputs, .. } = self.config;
        norm(x, e, normed);
        fresh(normed, e, &self.out, e, mixed);
        wide.clear();
        (0..x.len() / e).for_each(|_| wide.extend_from_slice(&self.hidden_bias));
        product(mixed, e, &self.hidden, head, wide, true);
        relu(wide);
        out.chunks_exact_mut(outputs).for_each(|row| row.copy_from_slice(&self.head_bias));
        product(wide, head, &self.head, outputs, out, true);
    }
}

impl Block {
    /// `x += W_down gelu(W_up LN(x))`.
    fn mlp(&self, e: usize, x: &mut [f32], normed: &mut Vec<f32>, wide: &mut Vec<f32>) {
        norm(x, e, normed);
        fresh(normed, e, &self.up, 4 * e, wide);
        gelu(wide);
        product(wide, 4 * e, &self.down, e, x, true);
    }
}

/// Rows shifted and scaled to mean 0, variance 1.
fn norm(x: &[f32], e: usize, out: &mut Vec<f32>) {
    out.clear();
    out.extend_from_slice(x);
    normalize(out, e);
}

/// `out = x W` for rows of `x`.
fn fresh(x: &[f32], inner: usize, w: &[f32], outer: usize, out: &mut Vec<f32>) {
    out.resize(x.len() / inner * outer, 0.0);
    product(x, inner, w, outer, out, false);
}

/// `out = x W`, or `out += x W`, on this thread.
fn product(x: &[f32], inner: usize, w: &[f32], outer: usize, out: &mut [f32], add: bool) {
    let rows = x.len() / inner;
    let accumulate = if add { Accum::Add } else { Accum::Replace };
    let (x, w) = (MatRef::from_row_major_slice(x, rows, inner), MatRef::from_row_major_slice(w, inner, outer));
    matmul(MatMut::from_row_major_slice_mut(out, rows, outer), accumulate, x, w, 1.0f32, Par::Seq);
}
