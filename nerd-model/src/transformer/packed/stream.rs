//! [`Stream`] for rotary positions: keys and values of old tokens are kept, one token is computed a frame.
//!
//! Tokens of frames in which nothing is asked of an environment wait. The next time it is asked they are computed with the new
//! one, all in one pass, so that flight costs nothing until it ends. A prediction depends on the last
//! [`TransformerConfig::reach`] tokens alone, so no more than these wait.
//!
//! A key is turned once, by its place since the environment was cleared, and so is a query: what they make of each other depends on
//! their distance alone. The angle of the place is kept as a unit vector that every frame turns on, so that it may grow for ever.

use std::collections::VecDeque;

use pulp::Arch;
use rayon::prelude::*;

use super::ROWS;
use super::attention::{Attend, Columns};
use crate::program::cpu::{Loaded, Memory, Pass};
use crate::transformer::{ForwardError, Positions, Stream, TransformerConfig, Weights};

/// A network that remembers.
pub struct PackedStream {
    config: TransformerConfig,
    network: Loaded,
    columns: Columns,
    /// Cosines and sines of a frame's turn, `[2][d / 2]`.
    turn: Vec<f64>,
    /// The same of the newest token's place, `[env][2][d / 2]`.
    places: Vec<f64>,
    /// Keys, turned, and values: `[env][layer][2][slot][columns]`.
    rings: Vec<f32>,
    /// Tokens of each environment that were computed since it was cleared.
    taken: Vec<usize>,
    /// Tokens that came since the last of these, oldest first, `[env][token][inputs]`.
    waiting: Vec<VecDeque<f32>>,
    work: Vec<Work>,
}

/// What one thread computes.
#[derive(Default)]
struct Work {
    memory: Memory,
    rows: Vec<Row>,
    tokens: Vec<f32>,
    /// Of their places.
    turns: Vec<f32>,
    scratch: Vec<f32>,
    newest: Vec<usize>,
    /// `[asked][outputs]`.
    out: Vec<f32>,
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
        let (program, flat) = columns.arrange(c.program(), &weights.flat);
        let network = Loaded::new(program, &flat);
        let turn = c.frequencies().map(f64::cos).chain(c.frequencies().map(f64::sin)).collect();
        Self {
            config: c,
            network,
            columns,
            turn,
            places: Vec::new(),
            rings: Vec::new(),
            taken: Vec::new(),
            waiting: Vec::new(),
            work: Vec::new(),
        }
    }

    /// Floats of one environment's keys and values.
    fn ring(&self) -> usize {
        let c = &self.config;
        c.layers * c.history * 2 * self.columns.width
    }
}

impl Stream for PackedStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let c = self.config;
        let envs = crate::transformer::stream::check(&c, tokens, asked)?;
        let ring = self.ring();
        self.rings.resize(envs * ring, 0.0);
        self.taken.resize(envs, 0);
        self.waiting.resize_with(envs, VecDeque::new);
        let d = self.turn.len();
        self.places.resize(envs * d, 0.0);
        // Even blocks of environments, as many as keep every thread busy.
        let threads = rayon::current_num_threads();
        let size = envs.div_ceil(threads * envs.div_ceil(threads * ROWS).max(1)).max(1);
        let mut work = std::mem::take(&mut self.work);
        work.resize_with(work.len().max(envs.div_ceil(size)), Work::default);
        let (network, columns, turn) = (&self.network, &self.columns, &self.turn);
        let kept = self.rings.par_chunks_mut(size * ring).zip(self.places.par_chunks_mut(size * d));
        let kept = kept.zip(self.taken.par_chunks_mut(size)).zip(self.waiting.par_chunks_mut(size));
        kept.zip(work.par_iter_mut()).enumerate().for_each(|(i, ((((rings, places), taken), waiting), work))| {
            let first = i * size;
            let from = asked.partition_point(|env| *env < first);
            let to = asked.partition_point(|env| *env < first + taken.len());
            let tokens = &tokens[first * c.inputs..][..taken.len() * c.inputs];
            let mut block = Envs { config: &c, network, columns, turn, places, rings, taken, waiting, first };
            block.push(tokens, &asked[from..to], work);
        });
        out.clear();
        work.iter().take(envs.div_ceil(size)).for_each(|part| out.extend_from_slice(&part.out));
        self.work = work;
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        if let Some(taken) = self.taken.get_mut(env) {
            *taken = 0;
            self.waiting[env].clear();
        }
    }
}

/// A token that is computed.
struct Row {
    env: usize,
    /// Tokens of its environment before it.
    before: usize,
    /// Whether it is the environment's newest, which is asked.
    newest: bool,
}

/// A block of environments, counted from `first`.
struct Envs<'a> {
    config: &'a TransformerConfig,
    network: &'a Loaded,
    columns: &'a Columns,
    turn: &'a [f64],
    places: &'a mut [f64],
    rings: &'a mut [f32],
    taken: &'a mut [usize],
    waiting: &'a mut [VecDeque<f32>],
    first: usize,
}

impl Envs<'_> {
    /// A token of each environment, and predictions `[asked][outputs]`.
    fn push(&mut self, tokens: &[f32], asked: &[usize], work: &mut Work) {
        let c = self.config;
        let most = c.reach() * c.inputs;
        for (waiting, token) in self.waiting.iter_mut().zip(tokens.chunks_exact(c.inputs)) {
            if waiting.len() == most {
                waiting.drain(..c.inputs);
            }
            waiting.extend(token);
        }
        work.out.resize(asked.len() * c.outputs, 0.0);
        let (mut first, mut asked) = (0, asked);
        while !asked.is_empty() {
            let envs = self.take(asked, work);
            self.compute(work, first * c.outputs..(first + envs) * c.outputs);
            (first, asked) = (first + envs, &asked[envs..]);
        }
    }

    /// Lays out the waiting tokens of as many environments as make a block; their number.
    fn take(&mut self, asked: &[usize], work: &mut Work) -> usize {
        let Work { rows, tokens, turns, .. } = work;
        let width = self.config.inputs;
        rows.clear();
        [&mut *tokens, turns].into_iter().for_each(Vec::clear);
        for (done, env) in asked.iter().enumerate() {
            let env = env - self.first;
            let count = self.waiting[env].len() / width;
            if done > 0 && rows.len() + count > ROWS {
                return done;
            }
            tokens.extend(self.waiting[env].drain(..));
            for k in 1..=count {
                self.place(env, turns);
                rows.push(Row { env, before: self.taken[env], newest: k == count });
                self.taken[env] += 1;
            }
        }
        asked.len()
    }

    /// Predictions of the newest token of each environment laid out, into `part` of those of all.
    fn compute(&mut self, work: &mut Work, part: std::ops::Range<usize>) {
        let TransformerConfig { layers, history, .. } = *self.config;
        let Work { memory, rows, tokens, turns, scratch, newest, out } = work;
        newest.clear();
        newest.extend(rows.iter().enumerate().filter_map(|(i, row)| row.newest.then_some(i)));
        // Rows of one environment come in the order of time, so each finds the keys of those before it.
        let mut mix = |layer: usize, qkv: &mut [f32], mixed: &mut Vec<f32>| {
            mixed.resize(rows.len() * self.columns.width, 0.0);
            Arch::new().dispatch(Attend {
                columns: self.columns,
                envs: &mut rows.iter().map(|row| (row.env, row.before)),
                rings: self.rings,
                layer,
                layers,
                history,
                qkv,
                turns,
                out: mixed,
                scratch,
            });
        };
        out[part].copy_from_slice(self.network.forward(tokens, memory, Pass::Stream(&mut mix, newest)));
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
