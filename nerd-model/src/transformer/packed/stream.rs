//! [`Stream`] for rotary positions: keys and values of old tokens are kept, one token is computed a frame.

use pulp::Arch;
use rayon::prelude::*;

use super::{Memory, Packed, ROWS, fresh, norm, product};
use crate::transformer::elementwise::softmax;
use crate::transformer::{ForwardError, Positions, Stream, TransformerConfig, Weights};

/// A network that remembers.
pub struct PackedStream {
    packed: Packed,
    /// Cosines and sines of each distance in time, `[history][d / 2]`.
    turns: Vec<(f32, f32)>,
    /// Keys and values `[env][layer][slot][2 E]`, keys not turned.
    rings: Vec<f32>,
    /// Tokens taken of each environment since it was cleared.
    taken: Vec<usize>,
    memory: Vec<(Memory, Vec<f32>)>,
}

impl PackedStream {
    /// Packs `weights`.
    ///
    /// # Panics
    /// If their positions are a table; that network wants [`super::PackedForward`].
    pub fn new(weights: &Weights) -> Self {
        let c = weights.config;
        assert_eq!(c.positions, Positions::Rotary, "keys and values can be kept only if positions are relative");
        let turns = (0..c.history).flat_map(|distance| c.turn(distance)).collect();
        Self { packed: Packed::new(weights), turns, rings: Vec::new(), taken: Vec::new(), memory: Vec::new() }
    }

    /// Floats of one environment's keys and values.
    fn ring(&self) -> usize {
        let c = &self.packed.config;
        c.layers * c.history * 2 * c.embedding
    }
}

impl Stream for PackedStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let c = self.packed.config;
        let envs = crate::transformer::stream::check(&c, tokens, asked)?;
        let ring = self.ring();
        self.rings.resize(envs * ring, 0.0);
        self.taken.resize(envs, 0);
        // Even blocks of environments, as many as keep every thread busy.
        let threads = rayon::current_num_threads();
        let size = envs.div_ceil(threads * envs.div_ceil(threads * ROWS).max(1)).max(1);
        let mut memory = std::mem::take(&mut self.memory);
        memory.resize_with(memory.len().max(envs.div_ceil(size)), Default::default);
        let (packed, turns) = (&self.packed, &self.turns);
        let blocks = self.rings.par_chunks_mut(size * ring).zip(self.taken.par_chunks_mut(size)).zip(memory.par_iter_mut());
        blocks.enumerate().for_each(|(i, ((rings, taken), (memory, out)))| {
            let first = i * size;
            let from = asked.partition_point(|env| *env < first);
            let to = asked.partition_point(|env| *env < first + taken.len());
            let block = Envs { packed, turns, rings, taken, asked: &asked[from..to], first };
            block.push(tokens, memory, out);
        });
        out.clear();
        memory.iter().take(envs.div_ceil(size)).for_each(|(_, part)| out.extend_from_slice(part));
        self.memory = memory;
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        if let Some(taken) = self.taken.get_mut(env) {
            *taken = 0;
        }
    }
}

/// A block of environments, counted from `first`.
struct Envs<'a> {
    packed: &'a Packed,
    turns: &'a [(f32, f32)],
    rings: &'a mut [f32],
    taken: &'a mut [usize],
    asked: &'a [usize],
    first: usize,
}

impl Envs<'_> {
    fn push(mut self, tokens: &[f32], memory: &mut Memory, out: &mut Vec<f32>) {
        let TransformerConfig { inputs: width, embedding: e, outputs, .. } = self.packed.config;
        let Memory { x, normed, qkv, mixed, wide, newest, scores, turned } = memory;
        newest.clear();
        x.clear();
        for env in self.asked {
            newest.extend_from_slice(&tokens[env * width..(env + 1) * width]);
            x.extend_from_slice(&self.packed.place);
        }
        out.resize(self.asked.len() * outputs, 0.0);
        if !self.asked.is_empty() {
            product(newest, width, &self.packed.embed, e, x, true);
            for (layer, block) in self.packed.blocks.iter().enumerate() {
                norm(x, e, normed);
                fresh(normed, e, &block.qkv, 3 * e, qkv);
                mixed.clear();
                mixed.resize(x.len(), 0.0);
                self.attend(layer, qkv, mixed, (scores, turned));
                product(mixed, e, &block.proj, e, x, true);
                block.mlp(e, x, normed, wide);
            }
            self.packed.top(x, normed, mixed, wide, out);
        }
        // Who was not asked has a gap in its past, and forgets it.
        let mut asked = self.asked.iter().peekable();
        for (i, taken) in self.taken.iter_mut().enumerate() {
            *taken = if asked.next_if_eq(&&(self.first + i)).is_some() { *taken + 1 } else { 0 };
        }
    }

    /// Keeps the keys and values of rows `qkv`, and attends to those of the last h tokens.
    fn attend(&mut self, layer: usize, qkv: &[f32], out: &mut [f32], (scores, turned): (&mut Vec<f32>, &mut Vec<f32>)) {
        let TransformerConfig { embedding: e, heads, history: h, layers, .. } = self.packed.config;
        let (d, scale) = (e / heads, ((e / heads) as f32).powf(-0.5));
        scores.resize(heads * h, 0.0);
        turned.resize(e, 0.0);
        Arch::new().dispatch(|| {
            for ((env, row), out) in self.asked.iter().zip(qkv.chunks_exact(3 * e)).zip(out.chunks_exact_mut(e)) {
                let i = env - self.first;
                let ring = &mut self.rings[(i * layers + layer) * h * 2 * e..][..h * 2 * e];
                let (now, q) = (self.taken[i], &row[..e]);
                ring[now % h * 2 * e..][..2 * e].copy_from_slice(&row[e..]);
                let seen = (now + 1).min(h);
                // Turning a query by the distance to a key is turning both by their places.
                for distance in 0..seen {
                    let key = &ring[(now - distance) % h * 2 * e..][..e];
                    let turn = &self.turns[distance * (d / 2)..][..d / 2];
                    for (q, turned) in q.chunks_exact(d).zip(turned.chunks_exact_mut(d)) {
                        let ((a, b), (x, y)) = (q.split_at(d / 2), turned.split_at_mut(d / 2));
                        for (m, (cos, sin)) in turn.iter().enumerate() {
                            x[m] = a[m] * cos - b[m] * sin;
                            y[m] = a[m] * sin + b[m] * cos;
                        }
                    }
                    for (head, (q, k)) in turned.chunks_exact(d).zip(key.chunks_exact(d)).enumerate() {
                        scores[head * h + distance] = scale * q.iter().zip(k).map(|(a, b)| a * b).sum::<f32>();
                    }
                }
                scores.chunks_exact_mut(h).for_each(|scores| softmax(&mut scores[..seen]));
                for distance in 0..seen {
                    let value = &ring[(now - distance) % h * 2 * e + e..][..e];
                    for (head, (sum, v)) in out.chunks_exact_mut(d).zip(value.chunks_exact(d)).enumerate() {
                        let share = scores[head * h + distance];
                        sum.iter_mut().zip(v).for_each(|(s, v)| *s += share * v);
                    }
                }
            }
        });
    }
}
