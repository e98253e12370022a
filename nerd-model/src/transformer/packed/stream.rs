//! [`Stream`] for rotary positions: keys and values of old tokens are kept, one token is computed a frame.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::{Memory, Packed, ROWS, norm};
use crate::transformer::elementwise::{dot, softmax_by_head};
use crate::transformer::{ForwardError, Positions, Stream, TransformerConfig, Weights};

/// Floats that every processor of the last decade multiplies at once.
const LANES: usize = 8;

/// A network that remembers.
pub struct PackedStream {
    packed: Packed,
    /// Cosines and sines of each distance in time, `[history][2][d / 2]`.
    turns: Vec<f32>,
    /// Keys, not turned, and values: `[env][layer][2][slot][E]`.
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
        let (cos, sin) = (|t: &(f32, f32)| t.0, |t: &(f32, f32)| t.1);
        let of = |turn: Vec<(f32, f32)>| turn.iter().map(cos).chain(turn.iter().map(sin)).collect::<Vec<f32>>();
        let turns = (0..c.history).flat_map(|distance| of(c.turn(distance))).collect();
        Self { packed: Packed::new(weights, |i| i), turns, rings: Vec::new(), taken: Vec::new(), memory: Vec::new() }
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
    turns: &'a [f32],
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
            self.packed.embed.add_product(newest, x);
            for (layer, block) in self.packed.blocks.iter().enumerate() {
                norm(x, e, normed);
                block.qkv.product(normed, qkv);
                mixed.clear();
                mixed.resize(x.len(), 0.0);
                Arch::new().dispatch(Attend { envs: &mut self, layer, qkv, out: mixed, scores, turned });
                block.proj.add_product(mixed, x);
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
}

/// Attention of one new token of each environment to its last ones. A type, not a closure, so that the compiler can be made to
/// inline it where the vectors are wide.
struct Attend<'a, 'b> {
    envs: &'b mut Envs<'a>,
    layer: usize,
    qkv: &'b [f32],
    out: &'b mut [f32],
    scores: &'b mut Vec<f32>,
    turned: &'b mut Vec<f32>,
}

impl NullaryFnOnce for Attend<'_, '_> {
    type Output = ();

    /// Keeps the keys and values of rows `qkv`, and mixes the values of the last h tokens.
    #[inline(always)]
    fn call(self) {
        let Envs { packed, turns, rings, taken, asked, first } = self.envs;
        let TransformerConfig { embedding: e, heads, history: h, layers, .. } = packed.config;
        let (d, scale) = (e / heads, ((e / heads) as f32).powf(-0.5));
        self.scores.resize(heads * (h + 2), 0.0);
        let (scores, rest) = self.scores.split_at_mut(heads * h);
        let (most, total) = rest.split_at_mut(heads);
        self.turned.resize(e, 0.0);
        for ((env, row), out) in asked.iter().zip(self.qkv.chunks_exact(3 * e)).zip(self.out.chunks_exact_mut(e)) {
            let i = env - *first;
            let ring = &mut rings[(i * layers + self.layer) * h * 2 * e..][..h * 2 * e];
            let (keys, values) = ring.split_at_mut(h * e);
            let (now, q) = (taken[i], &row[..e]);
            let (newest, seen) = (now % h, (now + 1).min(h));
            keys[newest * e..][..e].copy_from_slice(&row[e..2 * e]);
            values[newest * e..][..e].copy_from_slice(&row[2 * e..]);
            // Turning a query by the distance to a key is turning both by their places.
            let scores = &mut scores[..seen * heads];
            for ((slot, key), scores) in keys.chunks_exact(e).enumerate().zip(scores.chunks_exact_mut(heads)) {
                turn(q, &turns[(newest + h - slot) % h * d..][..d], self.turned);
                for ((q, k), score) in self.turned.chunks_exact(d).zip(key.chunks_exact(d)).zip(scores) {
                    *score = scale * dot(q, k);
                }
            }
            softmax_by_head(scores, heads, most, total);
            for (value, shares) in values.chunks_exact(e).zip(scores.chunks_exact(heads)) {
                for ((sum, v), share) in out.chunks_exact_mut(d).zip(value.chunks_exact(d)).zip(shares) {
                    sum.iter_mut().zip(v).for_each(|(s, v)| *s += share * v);
                }
            }
        }
    }
}

/// Turns the columns m and m + d/2 of every head of `q` together; `angles` are d/2 cosines and as many sines.
#[inline(always)]
fn turn(q: &[f32], angles: &[f32], out: &mut [f32]) {
    let (d, half) = (angles.len(), angles.len() / 2);
    let (cos, sin) = angles.split_at(half);
    let ((cos, cos_rest), (sin, sin_rest)) = (cos.as_chunks::<LANES>(), sin.as_chunks::<LANES>());
    for (q, out) in q.chunks_exact(d).zip(out.chunks_exact_mut(d)) {
        let ((a, b), (x, y)) = (q.split_at(half), out.split_at_mut(half));
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        let ((x, x_rest), (y, y_rest)) = (x.as_chunks_mut::<LANES>(), y.as_chunks_mut::<LANES>());
        for i in 0..x.len() {
            turn_by(&a[i], &b[i], &cos[i], &sin[i], &mut x[i], &mut y[i]);
        }
        turn_by(a_rest, b_rest, cos_rest, sin_rest, x_rest, y_rest);
    }
}

/// `(x, y) = (a cos - b sin, a sin + b cos)`.
#[inline(always)]
fn turn_by(a: &[f32], b: &[f32], cos: &[f32], sin: &[f32], x: &mut [f32], y: &mut [f32]) {
    for i in 0..x.len() {
        x[i] = a[i] * cos[i] - b[i] * sin[i];
        y[i] = a[i] * sin[i] + b[i] * cos[i];
    }
}
