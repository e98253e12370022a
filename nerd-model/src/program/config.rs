//! Shape of a network; what it computes is written in [`super::networks`].

use nerd_sim::range::within;
use serde::{Deserialize, Serialize};

/// Architecture that maps windows to predictions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Architecture {
    /// The causal Transformer.
    #[default]
    Transformer,
    /// Its blocks without attention, over single tokens.
    Residual,
    /// A network along a chain ([`crate::chain`]): a window is its rods in one frame, and `block` their number.
    Chain,
}

/// Whether a value is the default, which files leave out.
pub(crate) fn usual<T: Default + PartialEq>(x: &T) -> bool {
    *x == T::default()
}

/// Hyper-parameters of the Transformer. Everything is a count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformerConfig {
    /// Width of one input token (6 for Cartpole, 37 for the double pendulum).
    pub inputs: usize,
    /// Width of one prediction: the state dimension.
    pub outputs: usize,
    /// Embedding size E (paper: 192 or 384).
    pub embedding: usize,
    /// Number of blocks (paper: 6).
    pub layers: usize,
    /// Attention heads; E is a multiple of it (paper: 12).
    pub heads: usize,
    /// Rows of the learned position table (paper: 32), or tokens of a training sequence where positions are rotary; at
    /// least `history`.
    pub block: usize,
    /// Tokens that a token sees, itself included, h (paper: 10).
    pub history: usize,
    /// Hidden width of the head MLP (paper: 64).
    pub head: usize,
    /// How a token's position in time is encoded.
    #[serde(default)]
    pub positions: Positions,
    /// Network between tokens and head; for others than the Transformer `embedding` is the width, and `heads` and `block` are unused.
    #[serde(default, skip_serializing_if = "usual")]
    pub architecture: Architecture,
}

/// How a token's position in time is encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Positions {
    /// A learned table, one row for each place in the window (paper). Every frame recomputes the window.
    #[default]
    Table,
    /// Rotated queries and keys under a banded causal mask. Every frame computes its own token only.
    Rotary,
}

/// Angle per token of column pair 0; pair m of a head of width d has `ROTARY_BASE^(-2m/d)` times it. Smaller than the 10 000 of language
/// models, whose contexts are thousands of tokens long.
const ROTARY_BASE: f64 = 100.0;

/// Most parameters of a network: 4 GiB of weights.
const MOST_PARAMETERS: usize = 1 << 30;

impl TransformerConfig {
    /// The paper's network for a robot with `inputs` features and `outputs` state coordinates.
    pub fn paper(inputs: usize, outputs: usize, embedding: usize) -> Self {
        let (positions, architecture) = Default::default();
        Self { inputs, outputs, embedding, layers: 6, heads: 12, block: 32, history: 10, head: 64, positions, architecture }
    }

    /// Tokens of a training sequence: the window, or a longer one where positions are rotary.
    pub fn sequence(&self) -> usize {
        match self.positions {
            Positions::Table => self.history,
            Positions::Rotary => self.block,
        }
    }

    /// Frames that a prediction depends on, its own included: the window. With rotary positions, `history - 1` more for every layer, since
    /// a layer's stored keys and values already depend on earlier tokens.
    pub fn reach(&self) -> usize {
        match (self.positions, self.architecture) {
            (Positions::Rotary, Architecture::Transformer) => self.layers * (self.history - 1) + 1,
            _ => self.history,
        }
    }

    /// Angle (rad) by which each pair of a head's columns is rotated from one token to the next, `[d / 2]`; columns m and m + d/2 form a
    /// pair.
    pub fn frequencies(&self) -> impl Iterator<Item = f64> {
        let half = self.embedding / self.heads / 2;
        (0..half).map(move |m| ROTARY_BASE.powf(-(m as f64) / half as f64))
    }

    /// Refuses an impossible shape, naming the key. An accepted shape has at most 2^30 parameters, so that no count overflows and its
    /// memory is known before any is allocated.
    pub fn check(&self) -> Result<(), String> {
        let Self { inputs, outputs, embedding, layers, heads, block, history, head, .. } = *self;
        let counts = [
            ("`inputs`", inputs, 1 << 16),
            ("`outputs`", outputs, 1 << 16),
            ("`embedding`", embedding, 4096),
            ("`layers`", layers, 64),
            ("`head`", head, 1 << 14),
            ("`block`", block, 8192),
            ("`history`", history, block.min(1024)),
        ];
        counts.iter().try_for_each(|(key, found, most)| within(key, *found as f64, 1.0..=*most as f64, ""))?;
        // These keys apply to the Transformer alone.
        if self.architecture == Architecture::Transformer {
            within("`embedding`", embedding as f64, 2.0..=4096.0, "")?;
            let (even, most) = match self.positions {
                Positions::Table => (1, embedding / 2),
                Positions::Rotary => (2, 64.min(embedding / 2)),
            };
            within("`heads`", heads as f64, 1.0..=most as f64, "")?;
            if !embedding.is_multiple_of(heads * even) {
                let pairs = if even == 2 { "; rotary positions turn the columns of a head in pairs" } else { "" };
                return Err(format!("`heads` is {heads}, it must divide the width of {embedding}{pairs}"));
            }
        }
        // Below the bounds no product of these overflows.
        match self.parameters() {
            n if n > MOST_PARAMETERS => Err(format!("{n} parameters: at most {MOST_PARAMETERS} can be held")),
            _ => Ok(()),
        }
    }
}
