//! [`Forward`] over whole windows: the last block computes the newest tokens alone.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::{Memory, Packed, ROWS, norm};
use crate::transformer::elementwise::{dot, softmax};
use crate::transformer::{Forward, ForwardError, Positions, TransformerConfig, Weights};

/// A network that recomputes windows.
pub struct PackedForward {
    packed: Packed,
    memory: Vec<Memory>,
}

impl PackedForward {
    /// Packs `weights`.
    ///
    /// # Panics
    /// If their positions are rotary; that network wants [`super::PackedStream`].
    pub fn new(weights: &Weights) -> Self {
        assert_eq!(weights.config.positions, Positions::Table, "whole windows are for position tables");
        Self { packed: Packed::new(weights, weights.config.embedding, Some), memory: Vec::new() }
    }

    /// One block of windows.
    fn block(&self, inputs: &[f32], tokens: usize, last: &[u32], memory: &mut Memory, out: &mut [f32]) {
        let TransformerConfig { embedding: e, .. } = self.packed.config;
        let Memory { x, normed, qkv, mixed, wide, newest, scores, .. } = memory;
        let rows = last.len() * tokens;
        x.resize(rows * e, 0.0);
        for token in x.chunks_exact_mut(tokens * e) {
            token.copy_from_slice(&self.packed.place[..tokens * e]);
        }
        self.packed.embed.add_product(inputs, x);
        let Some((tail, body)) = self.packed.blocks.split_last() else { return };
        for block in body {
            norm(x, e, normed);
            block.qkv.product(normed, qkv);
            self.attend(qkv, (0..rows).map(|row| (row, row % tokens)), scores, mixed);
            block.proj.add_product(mixed, x);
            block.mlp(e, x, normed, wide);
        }
        // The newest tokens alone go through the last block: keys and values of all, the rest of them.
        norm(x, e, normed);
        tail.qkv.product(normed, qkv);
        let places = last.iter().enumerate().map(|(w, l)| (w * tokens + *l as usize, *l as usize));
        newest.clear();
        places.clone().for_each(|(row, _)| newest.extend_from_slice(&x[row * e..(row + 1) * e]));
        self.attend(qkv, places, scores, mixed);
        tail.proj.add_product(mixed, newest);
        tail.mlp(e, newest, normed, wide);
        self.packed.top(newest, normed, mixed, wide, out);
    }

    /// Attention of the rows `(row, place in its window)` over the tokens up to their place.
    fn attend(&self, qkv: &[f32], rows: impl Iterator<Item = (usize, usize)>, scores: &mut Vec<f32>, out: &mut Vec<f32>) {
        Arch::new().dispatch(Attend { e: self.packed.config.embedding, heads: self.packed.config.heads, qkv, rows, scores, out });
    }
}

/// See [`PackedForward::attend`]. A type, not a closure, so that the compiler can be made to inline it where the vectors are
/// wide.
struct Attend<'a, I> {
    e: usize,
    heads: usize,
    qkv: &'a [f32],
    rows: I,
    scores: &'a mut Vec<f32>,
    out: &'a mut Vec<f32>,
}

impl<I: Iterator<Item = (usize, usize)>> NullaryFnOnce for Attend<'_, I> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { e, heads, qkv, rows, scores, out } = self;
        let d = e / heads;
        let scale = (d as f32).powf(-0.5);
        out.clear();
        for (row, place) in rows {
            let first = row - place;
            out.resize(out.len() + e, 0.0);
            let start = out.len() - e;
            scores.resize(place + 1, 0.0);
            for (head, sum) in out[start..].chunks_exact_mut(d).enumerate() {
                let at = head * d;
                let q = &qkv[row * 3 * e + at..][..d];
                for (j, score) in scores.iter_mut().enumerate() {
                    *score = scale * dot(q, &qkv[(first + j) * 3 * e + e + at..][..d]);
                }
                softmax(scores);
                for (j, share) in scores.iter().enumerate() {
                    let v = &qkv[(first + j) * 3 * e + 2 * e + at..][..d];
                    sum.iter_mut().zip(v).for_each(|(s, v)| *s += share * v);
                }
            }
        }
    }
}

impl Forward for PackedForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        crate::transformer::check(&self.packed.config, inputs, tokens, last)?;
        let c = self.packed.config;
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
