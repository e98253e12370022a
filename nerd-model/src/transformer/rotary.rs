//! [`Stream`] for rotary positions on the CPU: keys and values of old tokens are kept, one token is computed a frame.
//!
//! Keys and queries are rotated once, by their position since the environment was cleared, so their product depends on their distance only.
//! The angle is kept as a unit vector that every frame advances, so it never loses precision.

use pulp::Arch;
use rayon::prelude::*;

use super::forward::{ForwardError, ROWS, even};
use super::stream::{Stream, check};
use super::weights::Weights;
use crate::program::config::{Positions, TransformerConfig};
use crate::program::cpu::{Loaded, Memory, Pass, Ring};

/// A network with memory of earlier tokens.
pub struct PackedStream {
    network: Network,
    envs: Vec<Env>,
    work: Vec<Work>,
}

struct Network {
    config: TransformerConfig,
    loaded: Loaded,
    /// Cosine and sine of a frame's rotation, by pair of a head's columns.
    turn: Vec<(f64, f64)>,
    /// Floats of the keys and values of a layer.
    ring: usize,
}

struct Env {
    /// Tokens since it was cleared.
    taken: usize,
    /// Cosine and sine of the newest token's position, by pair.
    place: Vec<(f64, f64)>,
    /// A ring of each layer.
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
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let (network, c) = (&self.network, self.network.config);
        let envs = check(&c, tokens)?;
        self.envs.resize_with(envs, || Env { taken: 0, place: Vec::new(), past: vec![0.0; c.layers * network.ring] });
        out.resize(envs * c.outputs, 0.0);
        let size = even(envs, ROWS);
        self.work.resize_with(self.work.len().max(envs.div_ceil(size)), Work::default);
        let blocks = self.envs.par_chunks_mut(size).zip(tokens.par_chunks(size * c.inputs)).zip(out.par_chunks_mut(size * c.outputs));
        blocks.zip(&mut self.work).for_each(|(((envs, tokens), out), work)| work.push(network, envs, tokens, out));
        Ok(())
    }

    fn clear(&mut self, env: usize) {
        if let Some(env) = self.envs.get_mut(env) {
            env.taken = 0;
        }
    }

    /// Token count, positions, rings.
    fn remembered(&self, env: usize) -> Result<Vec<f64>, ForwardError> {
        let Some(Env { taken, place, past }) = self.envs.get(env).filter(|env| env.taken > 0) else { return Ok(Vec::new()) };
        let places = place.iter().flat_map(|(cos, sin)| [*cos, *sin]);
        Ok([*taken as f64].into_iter().chain(places).chain(past.iter().map(|x| f64::from(*x))).collect())
    }

    fn recall(&mut self, env: usize, memory: &[f64]) -> Result<(), ForwardError> {
        let (pairs, Some(kept)) = (self.network.turn.len(), self.envs.get_mut(env)) else {
            return Err(ForwardError { message: format!("environment {env} has had no frame yet") });
        };
        kept.taken = 0;
        let Some((taken, rest)) = memory.split_first() else { return Ok(()) };
        if rest.len() != 2 * pairs + kept.past.len() {
            return Err(ForwardError { message: format!("{} numbers are no memory of this network", memory.len()) });
        }
        let (places, past) = rest.split_at(2 * pairs);
        kept.taken = *taken as usize;
        kept.place = places.as_chunks::<2>().0.iter().map(|[cos, sin]| (*cos, *sin)).collect();
        kept.past.iter_mut().zip(past).for_each(|(kept, x)| *kept = *x as f32);
        Ok(())
    }
}

impl Work {
    /// Pushes a token of each environment of a block, and writes its predictions.
    fn push(&mut self, network: &Network, envs: &mut [Env], tokens: &[f32], out: &mut [f32]) {
        let Self { memory, turns, shares } = self;
        let TransformerConfig { embedding: e, heads, history, .. } = network.config;
        turns.clear();
        for env in envs.iter_mut() {
            env.turn(&network.turn);
            turns.extend(env.place.iter().map(|(cos, _)| *cos as f32).chain(env.place.iter().map(|(_, sin)| *sin as f32)));
        }
        let mut mix = |layer: usize, qkv: &mut [f32], mixed: &mut Vec<f32>| {
            mixed.resize(envs.len() * e, 0.0);
            Arch::new().dispatch(|| {
                let parts = qkv.chunks_exact_mut(3 * e).zip(mixed.chunks_exact_mut(e)).zip(turns.chunks_exact(2 * network.turn.len()));
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
    /// Advances its position by one token.
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
