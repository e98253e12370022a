//! [`Forward`] on the CPU without a tensor framework: faer's matrix products, everything else fused around them.
//!
//! Windows are cut into blocks whose activations stay in the second-level cache, one block to a thread at a time. LayerNorm
//! weights are folded into the matrices behind them (`diag(w) W`), the last block computes the newest tokens alone, and
//! element-wise work runs with the widest vectors the processor has. Equal to the burn module to rounding.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::Arch;
use rayon::prelude::*;

use super::config::TransformerConfig;
use super::elementwise::{gelu, normalize, relu, softmax};
use super::forward::{Forward, ForwardError};
use super::weights::Weights;

/// Rows (tokens) of a block.
const ROWS: usize = 160;

/// A network ready to be evaluated.
pub struct PackedForward {
    config: TransformerConfig,
    embed: Vec<f32>,
    /// Position row plus bias, by token.
    place: Vec<f32>,
    blocks: Vec<Block>,
    out: Vec<f32>,
    hidden: Vec<f32>,
    hidden_bias: Vec<f32>,
    head: Vec<f32>,
    head_bias: Vec<f32>,
    memory: Vec<Memory>,
}

/// Matrices of one block, `[in, out]` row-major.
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
}

impl PackedForward {
    /// Packs `weights`.
    pub fn new(weights: &Weights) -> Self {
        let c = weights.config;
        let e = c.embedding;
        let mut tensors = weights.iter().map(|(_, _, values)| values.to_vec());
        let mut next = || tensors.next().unwrap_or_default();
        let folded = |norm: Vec<f32>, mut matrix: Vec<f32>| {
            let width = matrix.len() / norm.len();
            matrix.chunks_exact_mut(width).zip(norm).for_each(|(row, w)| row.iter_mut().for_each(|x| *x *= w));
            matrix
        };
        let (embed, bias, position) = (next(), next(), next());
        let place = position.chunks_exact(e).flat_map(|row| row.iter().zip(&bias).map(|(p, b)| p + b)).collect();
        let mut blocks = Vec::new();
        for _ in 0..c.layers {
            let (norm, qkv, proj) = (next(), next(), next());
            let (norm_mlp, up, down) = (next(), next(), next());
            blocks.push(Block { qkv: folded(norm, qkv), proj, up: folded(norm_mlp, up), down });
        }
        let out = folded(next(), next());
        let (hidden, hidden_bias, head, head_bias) = (next(), next(), next(), next());
        Self { config: c, embed, place, blocks, out, hidden, hidden_bias, head, head_bias, memory: Vec::new() }
    }

    /// One block of windows.
    fn block(&self, inputs: &[f32], tokens: usize, last: &[u32], memory: &mut Memory, out: &mut [f32]) {
        let TransformerConfig { inputs: width, embedding: e, .. } = self.config;
        let Memory { x, normed, qkv, mixed, wide, newest } = memory;
        let (windows, rows) = (last.len(), last.len() * tokens);
        x.resize(rows * e, 0.0);
        for token in x.chunks_exact_mut(tokens * e) {
            token.copy_from_slice(&self.place[..tokens * e]);
        }
        product(inputs, width, &self.embed, e, x, true);
        let Some((tail, body)) = self.blocks.split_last() else { return };
        for block in body {
            norm(x, e, normed);
            fresh(normed, e, &block.qkv, 3 * e, qkv);
            self.attend(qkv, tokens, (0..rows).map(|row| (row, row % tokens)), mixed);
            product(mixed, e, &block.proj, e, x, true);
            mlp(block, e, x, normed, wide);
        }
        // The newest tokens alone go through the last block: keys and values of all, the rest of them.
        norm(x, e, normed);
        fresh(normed, e, &tail.qkv, 3 * e, qkv);
        let places = last.iter().enumerate().map(|(w, l)| (w * tokens + *l as usize, *l as usize));
        newest.clear();
        places.clone().for_each(|(row, _)| newest.extend_from_slice(&x[row * e..(row + 1) * e]));
        self.attend(qkv, tokens, places, mixed);
        product(mixed, e, &tail.proj, e, newest, true);
        mlp(tail, e, newest, normed, wide);
        norm(newest, e, normed);
        fresh(normed, e, &self.out, e, mixed);
        let head = self.config.head;
        wide.clear();
        (0..windows).for_each(|_| wide.extend_from_slice(&self.hidden_bias));
        product(mixed, e, &self.hidden, head, wide, true);
        relu(wide);
        out.chunks_exact_mut(self.head_bias.len()).for_each(|row| row.copy_from_slice(&self.head_bias));
        product(wide, head, &self.head, self.config.outputs, out, true);
    }

    /// Attention of the rows `(row, place in its window)` over the tokens up to their place.
    fn attend(&self, qkv: &[f32], tokens: usize, rows: impl Iterator<Item = (usize, usize)>, out: &mut Vec<f32>) {
        let (e, heads) = (self.config.embedding, self.config.heads);
        let d = e / heads;
        let scale = (d as f32).powf(-0.5);
        out.clear();
        let mut scores = vec![0.0f32; tokens];
        let arch = Arch::new();
        for (row, place) in rows {
            let first = row - place;
            out.resize(out.len() + e, 0.0);
            let start = out.len() - e;
            let sum = &mut out[start..];
            arch.dispatch(|| {
                for head in 0..heads {
                    let at = head * d;
                    let q = &qkv[row * 3 * e + at..][..d];
                    let scores = &mut scores[..=place];
                    for (j, score) in scores.iter_mut().enumerate() {
                        let k = &qkv[(first + j) * 3 * e + e + at..][..d];
                        *score = scale * q.iter().zip(k).map(|(a, b)| a * b).sum::<f32>();
                    }
                    softmax(scores);
                    let sum = &mut sum[at..at + d];
                    for (j, share) in scores.iter().enumerate() {
                        let v = &qkv[(first + j) * 3 * e + 2 * e + at..][..d];
                        sum.iter_mut().zip(v).for_each(|(s, v)| *s += share * v);
                    }
                }
            });
        }
    }
}

impl Forward for PackedForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        super::predictor::check(&self.config, inputs, tokens, last)?;
        let c = self.config;
        out.clear();
        out.resize(last.len() * c.outputs, 0.0);
        // Blocks of whole windows, as many as keep every thread busy.
        let most = (ROWS / tokens).max(1);
        let threads = rayon::current_num_threads();
        let size = last.len().div_ceil(threads * last.len().div_ceil(threads * most).max(1)).max(1);
        let mut memory = std::mem::take(&mut self.memory);
        memory.resize_with(memory.len().max(last.len().div_ceil(size)), Memory::default);
        let jobs = inputs.par_chunks(size * tokens * c.inputs).zip(last.par_chunks(size)).zip(out.par_chunks_mut(size * c.outputs));
        jobs.zip(memory.par_iter_mut()).for_each(|(((x, l), o), m)| self.block(x, tokens, l, m, o));
        self.memory = memory;
        Ok(())
    }
}

/// `x += W_down gelu(W_up LN(x))`.
fn mlp(block: &Block, e: usize, x: &mut [f32], normed: &mut Vec<f32>, wide: &mut Vec<f32>) {
    norm(x, e, normed);
    fresh(normed, e, &block.up, 4 * e, wide);
    gelu(wide);
    product(wide, 4 * e, &block.down, e, x, true);
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
