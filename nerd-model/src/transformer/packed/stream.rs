//! [`Stream`] for rotary positions: keys and values of old tokens are kept, one token is computed a frame.
//!
//! A key is turned once, by its place since the environment was cleared, and so is a query: what they make of each other depends on
//! their distance alone. The angle of the place is kept as a unit vector that every frame turns on, so that it may grow for ever.

use pulp::Arch;
use rayon::prelude::*;

use super::attention::{Attend, Columns};
use super::{Memory, Packed, ROWS, norm};
use crate::transformer::{ForwardError, Positions, Stream, TransformerConfig, Weights};

/// A network that remembers.
pub struct PackedStream {
    packed: Packed,
    columns: Columns,
    /// Cosines and sines of a frame's turn, `[2][d / 2]`.
    turn: Vec<f64>,
    /// The same of the newest token's place, `[env][2][d / 2]`.
    places: Vec<f64>,
    /// Keys, turned, and values: `[env][layer][2][slot][columns]`.
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
        let columns = Columns::new(&c);
        let packed = Packed::new(weights, columns.width, |i| columns.source(i));
        let turn = c.frequencies().map(f64::cos).chain(c.frequencies().map(f64::sin)).collect();
        Self { packed, columns, turn, places: Vec::new(), rings: Vec::new(), taken: Vec::new(), memory: Vec::new() }
    }

    /// Floats of one environment's keys and values.
    fn ring(&self) -> usize {
        let c = &self.packed.config;
        c.layers * c.history * 2 * self.columns.width
    }
}

impl Stream for PackedStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let c = self.packed.config;
        let envs = crate::transformer::stream::check(&c, tokens, asked)?;
        let ring = self.ring();
        self.rings.resize(envs * ring, 0.0);
        self.taken.resize(envs, 0);
        let d = self.turn.len();
        self.places.resize(envs * d, 0.0);
        // Even blocks of environments, as many as keep every thread busy.
        let threads = rayon::current_num_threads();
        let size = envs.div_ceil(threads * envs.div_ceil(threads * ROWS).max(1)).max(1);
        let mut memory = std::mem::take(&mut self.memory);
        memory.resize_with(memory.len().max(envs.div_ceil(size)), Default::default);
        let (packed, columns, turn) = (&self.packed, &self.columns, &self.turn);
        let kept = self.rings.par_chunks_mut(size * ring).zip(self.places.par_chunks_mut(size * d)).zip(self.taken.par_chunks_mut(size));
        kept.zip(memory.par_iter_mut()).enumerate().for_each(|(i, (((rings, places), taken), (memory, out)))| {
            let first = i * size;
            let from = asked.partition_point(|env| *env < first);
            let to = asked.partition_point(|env| *env < first + taken.len());
            let block = Envs { packed, columns, turn, places, rings, taken, asked: &asked[from..to], first };
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
    columns: &'a Columns,
    turn: &'a [f64],
    places: &'a mut [f64],
    rings: &'a mut [f32],
    taken: &'a mut [usize],
    asked: &'a [usize],
    first: usize,
}

impl Envs<'_> {
    fn push(mut self, tokens: &[f32], memory: &mut Memory, out: &mut Vec<f32>) {
        let TransformerConfig { inputs: width, embedding: e, outputs, layers, history, .. } = self.packed.config;
        let Memory { x, normed, qkv, mixed, wide, newest, scores, turns } = memory;
        newest.clear();
        x.clear();
        turns.clear();
        for env in self.asked {
            newest.extend_from_slice(&tokens[env * width..(env + 1) * width]);
            x.extend_from_slice(&self.packed.place);
            self.place(env - self.first, turns);
        }
        out.resize(self.asked.len() * outputs, 0.0);
        if !self.asked.is_empty() {
            self.packed.embed.add_product(newest, x);
            for (layer, block) in self.packed.blocks.iter().enumerate() {
                norm(x, e, normed);
                block.qkv.product(normed, qkv);
                mixed.resize(self.asked.len() * self.columns.width, 0.0);
                Arch::new().dispatch(Attend {
                    columns: self.columns,
                    envs: &mut self.asked.iter().map(|env| (env - self.first, self.taken[env - self.first])),
                    rings: self.rings,
                    layer,
                    layers,
                    history,
                    qkv,
                    turns,
                    out: mixed,
                    scratch: scores,
                });
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

    /// Turns the place of environment i on, and appends its cosines and sines, each once for every head: `[2][d / 2][heads]`.
    fn place(&mut self, i: usize, turns: &mut Vec<f32>) {
        let (d, heads) = (self.turn.len(), self.columns.heads);
        let (cos, sin) = self.places[i * d..][..d].split_at_mut(d / 2);
        let (cos_on, sin_on) = self.turn.split_at(d / 2);
        for m in 0..d / 2 {
            (cos[m], sin[m]) = match self.taken[i] {
                0 => (1.0, 0.0),
                _ => (cos[m] * cos_on[m] - sin[m] * sin_on[m], sin[m] * cos_on[m] + cos[m] * sin_on[m]),
            };
        }
        cos.iter().chain(&*sin).for_each(|x| turns.extend(std::iter::repeat_n(*x as f32, heads)));
    }
}
