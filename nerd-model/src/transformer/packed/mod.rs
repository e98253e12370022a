//! Networks on the CPU without a tensor framework: packed matrices, everything else fused around their products.
//!
//! LayerNorm weights are folded into the matrices behind them (`diag(w) W`), element-wise work runs with the widest
//! vectors the processor has, and rows are cut into blocks whose activations stay in the second-level cache, one block to
//! a thread at a time. Equal to the burn module to rounding.

mod attention;
mod matrix;
mod stream;
mod window;

use matrix::Matrix;

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
const ROWS: usize = 512;

/// A network's matrices.
struct Packed {
    config: TransformerConfig,
    embed: Matrix,
    /// What is added to an embedded token, by its place: position row plus bias; of rotary positions the bias alone.
    place: Vec<f32>,
    blocks: Vec<Block>,
    out: Matrix,
    hidden: Matrix,
    hidden_bias: Vec<f32>,
    head: Matrix,
    head_bias: Vec<f32>,
}

/// Matrices of one block.
struct Block {
    qkv: Matrix,
    proj: Matrix,
    up: Matrix,
    down: Matrix,
}

/// Activations of one thread.
#[derive(Default)]
struct Memory {
    x: Vec<f32>,
    tokens: Vec<f32>,
    normed: Vec<f32>,
    qkv: Vec<f32>,
    mixed: Vec<f32>,
    wide: Vec<f32>,
    newest: Vec<f32>,
    scores: Vec<f32>,
    turns: Vec<f32>,
}

impl Packed {
    /// Packs `weights`, with `width` columns of queries, keys and values in the order that `source` says, none of it zeros.
    fn new(weights: &Weights, width: usize, source: impl Fn(usize) -> Option<usize>) -> Self {
        let c = weights.config;
        let e = c.embedding;
        let mut tensors = weights.iter().map(|(_, _, values)| values.to_vec());
        let mut next = || tensors.next().unwrap_or_default();
        let folded = |norm: Vec<f32>, mut matrix: Vec<f32>| {
            let width = matrix.len() / norm.len();
            matrix.chunks_exact_mut(width).zip(norm).for_each(|(row, w)| row.iter_mut().for_each(|x| *x *= w));
            matrix
        };
        let (embed, bias) = (Matrix::new(c.inputs, &next()), next());
        let place = match c.positions {
            Positions::Table => next().chunks_exact(e).flat_map(|row| row.iter().zip(&bias).map(|(p, b)| p + b)).collect(),
            Positions::Rotary => bias,
        };
        let mut blocks = Vec::new();
        for _ in 0..c.layers {
            let qkv = folded(next(), next());
            let qkv: Vec<f32> = qkv.chunks_exact(e).flat_map(|part| (0..width).map(|i| source(i).map_or(0.0, |s| part[s]))).collect();
            let proj = next();
            let proj: Vec<f32> = (0..width).flat_map(|i| source(i).map_or(vec![0.0; e], |s| proj[s * e..][..e].to_vec())).collect();
            let up = folded(next(), next());
            let [qkv, up] = [qkv, up].map(|matrix| Matrix::new(e, &matrix));
            blocks.push(Block { qkv, proj: Matrix::new(width, &proj), up, down: Matrix::new(4 * e, &next()) });
        }
        let out = Matrix::new(e, &folded(next(), next()));
        let (hidden, hidden_bias, head, head_bias) = (Matrix::new(e, &next()), next(), Matrix::new(c.head, &next()), next());
        Self { config: c, embed, place, blocks, out, hidden, hidden_bias, head, head_bias }
    }

    /// From rows `[n, E]` behind the last block to predictions `[n, outputs]`.
    fn top(&self, x: &[f32], normed: &mut Vec<f32>, mixed: &mut Vec<f32>, wide: &mut Vec<f32>, out: &mut [f32]) {
        let TransformerConfig { embedding: e, outputs, .. } = self.config;
        norm(x, e, normed);
        self.out.product(normed, mixed);
        wide.clear();
        (0..x.len() / e).for_each(|_| wide.extend_from_slice(&self.hidden_bias));
        self.hidden.add_product(mixed, wide);
        relu(wide);
        out.chunks_exact_mut(outputs).for_each(|row| row.copy_from_slice(&self.head_bias));
        self.head.add_product(wide, out);
    }
}

impl Block {
    /// `x += W_down gelu(W_up LN(x))`.
    fn mlp(&self, e: usize, x: &mut [f32], normed: &mut Vec<f32>, wide: &mut Vec<f32>) {
        norm(x, e, normed);
        self.up.product(normed, wide);
        gelu(wide);
        self.down.add_product(wide, x);
    }
}

/// Rows shifted and scaled to mean 0, variance 1.
fn norm(x: &[f32], e: usize, out: &mut Vec<f32>) {
    out.clear();
    out.extend_from_slice(x);
    normalize(out, e);
}
