//! [`Stream`] for rotary positions on the CPU: caches keys and values of old tokens and computes one token per frame.
//!
//! Keys and queries are rotated once, by their position since the last clear. So the product of a query and a key
//! depends only on their distance in time. The angle is stored as a unit vector that every frame rotates, so it never
//! loses precision.

use pulp::Arch;
use rayon::prelude::*;

use super::forward::{ForwardResult, ROWS, even};
use super::stream::{Stream, check};
use super::weights::Weights;
use crate::program::config::{Positions, TransformerConfig};
use crate::program::cpu::{Loaded, Memory, Pass, Ring};

/// A network with cached keys and values of earlier tokens.
pub struct PackedStream {
    network: Network,
    envs: Vec<Env>,
    work: Vec<Work>,
}

struct Network {
    config: TransformerConfig,
    loaded: Loaded,
    /// Cosine and sine of the rotation in one frame, `[d / 2]`.
    turn: Vec<(f64, f64)>,
    /// Floats in the cache of a layer.
    ring: usize,
}

struct Env {
    /// Number of tokens since the last clear.
    taken: usize,
    /// Cosine and sine of the newest token's position, `[d / 2]`.
    place: Vec<(f64, f64)>,
    /// Cached keys and values, `[layer][ring]`.
    past: Vec<f32>,
}

#[derive(Default)]
struct Work {
    memory: Memory,
    /// Cosines and sines of the tokens' positions, `[env][2][d / 2]`.
    turns: Vec<f32>,
    shares: Vec<f32>,
}

impl PackedStream {
    /// Packs `weights`. Panics unless positions are rotary.
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
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> ForwardResult {
        let network = &self.network;
        let c = self.network.config;
        let envs = check(&c, tokens)?;
        self.envs.resize_with(envs, || Env { taken: 0, place: Vec::new(), past: vec![0.0; c.layers * network.ring] });
        out.resize(envs * c.outputs, 0.0);
        let size = even(envs, ROWS);
        self.work.resize_with(self.work.len().max(envs.div_ceil(size)), Work::default);
        let blocks = self
            .envs
            .par_chunks_mut(size)
            .zip(tokens.par_chunks(size * c.inputs))
            .zip(out.par_chunks_mut(size * c.outputs));
        blocks.zip(&mut self.work).for_each(|(((envs, tokens), out), work)| work.push(network, envs, tokens, out));
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        if let Some(env) = self.envs.get_mut(env) {
            env.taken = 0;
        }
    }
}

impl Work {
    /// Pushes one token per environment of a block, and writes their predictions.
    fn push(&mut self, network: &Network, envs: &mut [Env], tokens: &[f32], out: &mut [f32]) {
        let Self { memory, turns, shares } = self;
        let TransformerConfig { embedding: e, heads, history, .. } = network.config;
        turns.clear();
        for env in envs.iter_mut() {
            env.turn(&network.turn);
            turns.extend(
                env.place.iter().map(|(cos, _)| *cos as f32).chain(env.place.iter().map(|(_, sin)| *sin as f32)),
            );
        }
        let mut mix = |layer: usize, qkv: &mut [f32], mixed: &mut Vec<f32>| {
            mixed.resize(envs.len() * e, 0.0);
            Arch::new().dispatch(|| {
                let parts = qkv
                    .chunks_exact_mut(3 * e)
                    .zip(mixed.chunks_exact_mut(e))
                    .zip(turns.chunks_exact(2 * network.turn.len()));
                for (env, ((qkv, mixed), turns)) in envs.iter_mut().zip(parts) {
                    let past = &mut env.past[layer * network.ring..][..network.ring];
                    Ring { history, past, before: env.taken }.push(qkv, heads, turns, shares, mixed);
                }
            });
        };
        out.copy_from_slice(network.loaded.forward(tokens, memory, Pass::Stream(&mut mix)));
        envs.iter_mut().for_each(|env| env.taken += 1);
    }
}

impl Env {
    /// Advances the position by one token.
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
