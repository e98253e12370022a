//! [`Stream`] for rotary positions on the CPU: keys and values of old tokens are kept, one token is computed a frame.
//!
//! Tokens of frames without a prediction wait, and are computed with the next one that needs it, in one pass: flight costs nothing until it
//! ends. A prediction depends on the last [`TransformerConfig::reach`] tokens only, so no more than these wait.
//!
//! Keys and queries are rotated once, by their position since the environment was cleared, so their product depends on their distance only.
//! The angle is kept as a unit vector that every frame advances, so it never loses precision.

use std::collections::VecDeque;

use pulp::Arch;
use rayon::prelude::*;

use super::forward::{ForwardError, ROWS, even};
use super::stream::{Stream, check};
use super::weights::Weights;
use crate::program::config::{Positions, TransformerConfig};
use crate::program::cpu::{Loaded, Memory, Pass, Ring};

/// A network that remembers.
pub struct PackedStream {
    network: Network,
    envs: Vec<Env>,
    work: Vec<Work>,
}

struct Network {
    config: TransformerConfig,
    loaded: Loaded,
    /// Cosine and sine of a frame's turn, by pair of a head's columns.
    turn: Vec<(f64, f64)>,
    /// Floats of the keys and values of a layer.
    ring: usize,
}

/// What is remembered of an environment.
struct Env {
    /// Tokens that came since the last that was computed, oldest first, `[token][inputs]`.
    waiting: VecDeque<f32>,
    /// Tokens that were computed since it was cleared.
    taken: usize,
    /// Cosine and sine of the newest one's place, by pair.
    place: Vec<(f64, f64)>,
    /// A ring of each layer.
    past: Vec<f32>,
}

/// What one thread computes.
#[derive(Default)]
struct Work {
    memory: Memory,
    /// Environment of each row, and tokens of it before that.
    rows: Vec<(usize, usize)>,
    tokens: Vec<f32>,
    /// Cosines and sines of their places, `[row][2][d / 2]`.
    turns: Vec<f32>,
    /// Rows that are asked for.
    newest: Vec<usize>,
    shares: Vec<f32>,
    /// `[asked][outputs]`.
    out: Vec<f32>,
}

impl PackedStream {
    /// Packs `weights`, whose positions must be rotary.
    pub fn new(weights: &Weights) -> Self {
        let config = weights.config;
        assert_eq!(config.positions, Positions::Rotary, "keys and values can be kept only if positions are relative");
        let loaded = Loaded::new(config.program(), &weights.flat);
        let turn = config.frequencies().map(|f| (f.cos(), f.sin())).collect();
        let network = Network { config, loaded, turn, ring: Ring::floats(config.embedding, config.history) };
        Self { network, envs: Vec::new(), work: Vec::new() }
    }
}

impl Stream for PackedStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let (network, c) = (&self.network, self.network.config);
        let envs = check(&c, tokens, asked)?;
        self.envs.resize_with(envs, || Env {
            waiting: VecDeque::new(),
            taken: 0,
            place: Vec::new(),
            past: vec![0.0; c.layers * network.ring],
        });
        let size = even(envs, ROWS);
        self.work.resize_with(self.work.len().max(envs.div_ceil(size)), Work::default);
        let blocks = self.envs.par_chunks_mut(size).zip(tokens.par_chunks(size * c.inputs)).zip(self.work.par_iter_mut());
        blocks.enumerate().for_each(|(i, ((envs, tokens), work))| {
            let first = i * size;
            let [from, to] = [first, first + envs.len()].map(|end| asked.partition_point(|env| *env < end));
            work.push(network, envs, tokens, &asked[from..to], first);
        });
        out.clear();
        self.work.iter().take(envs.div_ceil(size)).for_each(|part| out.extend_from_slice(&part.out));
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        if let Some(env) = self.envs.get_mut(env) {
            env.taken = 0;
            env.waiting.clear();
        }
    }
}

impl Work {
    /// A token of each environment of a block that begins with the `first`, and predictions `[asked][outputs]`.
    fn push(&mut self, network: &Network, envs: &mut [Env], tokens: &[f32], asked: &[usize], first: usize) {
        let c = network.config;
        for (env, token) in envs.iter_mut().zip(tokens.chunks_exact(c.inputs)) {
            if env.waiting.len() == c.reach() * c.inputs {
                env.waiting.drain(..c.inputs);
            }
            env.waiting.extend(token);
        }
        self.out.clear();
        let mut rest = asked;
        while !rest.is_empty() {
            rest = self.take(network, envs, rest, first);
            self.compute(network, envs);
        }
    }

    /// Lays out the waiting tokens of as many environments as make a block; the others are left.
    fn take<'a>(&mut self, network: &Network, envs: &mut [Env], asked: &'a [usize], first: usize) -> &'a [usize] {
        self.rows.clear();
        self.tokens.clear();
        self.turns.clear();
        self.newest.clear();
        for (done, env) in asked.iter().enumerate() {
            let (i, env) = (env - first, &mut envs[env - first]);
            let count = env.waiting.len() / network.config.inputs;
            if done > 0 && self.rows.len() + count > ROWS {
                return &asked[done..];
            }
            self.tokens.extend(env.waiting.drain(..));
            for _ in 0..count {
                env.turn(&network.turn);
                self.turns.extend(env.place.iter().map(|(cos, _)| *cos as f32).chain(env.place.iter().map(|(_, sin)| *sin as f32)));
                self.rows.push((i, env.taken));
                env.taken += 1;
            }
            self.newest.push(self.rows.len() - 1);
        }
        &[]
    }

    /// Appends predictions of the newest token of each environment laid out.
    fn compute(&mut self, network: &Network, envs: &mut [Env]) {
        let Self { memory, rows, tokens, turns, newest, shares, out } = self;
        let TransformerConfig { embedding: e, heads, history, .. } = network.config;
        // Rows of one environment come in the order of time, so each finds the keys of those before it.
        let mut mix = |layer: usize, qkv: &mut [f32], mixed: &mut Vec<f32>| {
            mixed.resize(rows.len() * e, 0.0);
            Arch::new().dispatch(|| {
                let parts = qkv.chunks_exact_mut(3 * e).zip(mixed.chunks_exact_mut(e)).zip(turns.chunks_exact(2 * network.turn.len()));
                for ((env, before), ((qkv, mixed), turns)) in rows.iter().zip(parts) {
                    let past = &mut envs[*env].past[layer * network.ring..][..network.ring];
                    Ring { history, past, before: *before }.push(qkv, heads, turns, shares, mixed);
                }
            });
        };
        out.extend_from_slice(network.loaded.forward(tokens, memory, Pass::Stream(&mut mix, newest)));
    }
}

impl Env {
    /// Turns its place on.
    fn turn(&mut self, by: &[(f64, f64)]) {
        if self.taken == 0 {
            self.place.clear();
            return self.place.resize(by.len(), (1.0, 0.0));
        }
        for ((cos, sin), (cos_on, sin_on)) in self.place.iter_mut().zip(by) {
            (*cos, *sin) = (*cos * cos_on - *sin * sin_on, *sin * cos_on + *cos * sin_on);
        }
    }
}
