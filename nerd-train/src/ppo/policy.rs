//! The network of policy and value, with the moments of what goes in and of what values are in.
//!
//! One trunk, and behind it mean action, value and, if asked for, logarithm of the spread. An action is drawn from the normal
//! law `N(mu, exp(s)^2)`, s being a parameter by default; an environment clamps it to [-1, 1].

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::activation::Activation;
use super::mlp::{Mlp, Tape};
use super::normalizer::RunningMoments;
use crate::ranges::{OutOfRange, within};

/// Rows that one thread takes at a time; a gradient is summed over these in order, so that threads change no bit.
pub(super) const ROWS: usize = 512;

/// Shape of a policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Numbers of an observation.
    pub observation: usize,
    /// Observations that the network sees.
    pub stack: usize,
    /// Numbers of an action.
    pub action: usize,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Between them.
    pub activation: Activation,
    /// Whether the spread is an output.
    pub spread_by_state: bool,
}

impl Shape {
    /// Refuses what no policy can have, before any memory is taken for it.
    ///
    /// # Errors
    /// Names the first number that is out of its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        within("observation", self.observation, 1..=1 << 16)?;
        within("stack", self.stack, 1..=64)?;
        within("action", self.action, 1..=4096)?;
        within("layers of `hidden`", self.hidden.len(), 0..=16)?;
        self.hidden.iter().try_for_each(|width| within("hidden", *width, 1..=4096))
    }

    /// The network.
    pub fn network(&self) -> Mlp {
        let outputs = self.action + 1 + if self.spread_by_state { self.action } else { 0 };
        let sizes = [&[self.observation * self.stack], self.hidden.as_slice(), &[outputs]].concat();
        Mlp { sizes, activation: self.activation }
    }

    /// Parameters: the network's, then the spread's if it is no output.
    pub fn parameters(&self) -> usize {
        self.network().parameters() + if self.spread_by_state { 0 } else { self.action }
    }
}

/// A policy with its value.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Its shape.
    pub shape: Shape,
    /// Parameters, see [`Shape::parameters`].
    pub flat: Vec<f32>,
    /// Moments of (stacked) observations.
    pub seen: RunningMoments,
    /// Moments of returns.
    pub returns: RunningMoments,
}

/// What a policy says of n observations.
#[derive(Clone, Debug, Default)]
pub struct Answer {
    /// Mean actions `[n][action]`.
    pub mean: Vec<f32>,
    /// Logarithms of the spread `[n][action]`.
    pub spread: Vec<f32>,
    /// Normalised values `[n]`.
    pub value: Vec<f32>,
}

impl Policy {
    /// Random weights, spread 1.
    pub fn new(shape: Shape, rng: &mut ChaCha8Rng) -> Self {
        let network = shape.network();
        let mut flat = network.init(rng);
        if shape.spread_by_state {
            // The spread begins at 1 wherever one is.
            let (outputs, inside) = (shape.action * 2 + 1, network.sizes[network.sizes.len() - 2]);
            let start = flat.len() - (inside + 1) * outputs;
            flat[start..].chunks_exact_mut(outputs).for_each(|row| row[shape.action + 1..].fill(0.0));
        }
        flat.resize(shape.parameters(), 0.0);
        Self { seen: RunningMoments::new(shape.observation * shape.stack), returns: RunningMoments::new(1), flat, shape }
    }

    /// Mean, spread and value for rows of (stacked) observations.
    pub fn answer(&self, observations: &[f64]) -> Answer {
        let (network, a) = (self.shape.network(), self.shape.action);
        let width = self.shape.observation * self.shape.stack;
        let parts = observations.par_chunks(ROWS * width).map_init(Tape::default, |tape, rows| {
            tape.layers.resize_with(1, Vec::new);
            self.seen.rows(rows, &mut tape.layers[0]);
            network.forward(&self.flat, tape).to_vec()
        });
        let (mut answer, outputs) = (Answer::default(), network.sizes.last().copied().unwrap_or(1));
        for row in parts.collect::<Vec<_>>().iter().flat_map(|part| part.chunks_exact(outputs)) {
            answer.mean.extend_from_slice(&row[..a]);
            answer.value.push(row[a]);
            answer.spread.extend_from_slice(if self.shape.spread_by_state { &row[a + 1..] } else { self.spread() });
        }
        answer
    }

    /// SHA-256 of weights and moments, as lower-case hex.
    pub fn sha256(&self) -> String {
        let moments = [&self.seen, &self.returns].into_iter().flat_map(|m| m.mean.iter().chain(&m.variance));
        let bytes: Vec<u8> = self.flat.iter().flat_map(|w| w.to_le_bytes()).chain(moments.flat_map(|x| x.to_le_bytes())).collect();
        Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Values in units of reward.
    pub fn values(&self, answer: &Answer) -> Vec<f64> {
        answer.value.iter().map(|v| self.returns.restore(0, f64::from(*v))).collect()
    }

    /// The spread's parameters; empty if it is an output.
    pub fn spread(&self) -> &[f32] {
        &self.flat[self.shape.network().parameters()..]
    }
}
