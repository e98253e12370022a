//! Shape of a network. [`super::networks`] defines its operations.

use nerd_sim::range::within;
use serde::{Deserialize, Serialize};

/// Architecture of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Architecture {
    /// Causal Transformer.
    #[default]
    Transformer,
    /// Transformer blocks without attention, over single tokens.
    Residual,
    /// A network along a chain ([`crate::chain`]): a window contains the rods of one frame, and `block` is their
    /// number.
    Chain,
}

/// Whether a value is the default, which files omit.
pub(crate) fn usual<T: Default + PartialEq>(x: &T) -> bool {
    *x == T::default()
}

/// Shape of a network. All numbers are counts.
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
    /// Attention heads, a divisor of E (paper: 12).
    pub heads: usize,
    /// Rows of the learned position table (paper: 32), or with rotary positions the tokens of a training sequence. At
    /// least `history`.
    pub block: usize,
    /// Tokens h that a token attends to, itself included (paper: 10).
    pub history: usize,
    /// Hidden width of the head MLP (paper: 64).
    pub head: usize,
    /// How a token's position in time is encoded.
    #[serde(default)]
    pub positions: Positions,
    /// Architecture. For others than the Transformer `embedding` is the width; `heads` is unused, and so is `block`
    /// except for a chain.
    #[serde(default, skip_serializing_if = "usual")]
    pub architecture: Architecture,
}

/// How a token's position in time is encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Positions {
    /// A learned table, one row for each position in the window (paper). Every frame recomputes the window.
    #[default]
    Table,
    /// Rotated queries and keys under a banded causal mask. Every frame computes only its new token.
    Rotary,
}

/// Base of the rotary angles: column pair m of a head of width d rotates by `ROTARY_BASE^(-2m/d)` rad per token.
/// Language models, with thousands of tokens of context, use a larger base, 10 000.
const ROTARY_BASE: f64 = 100.0;

/// Largest number of parameters, 4 GiB in f32.
const MOST_PARAMETERS: usize = 1 << 30;

impl TransformerConfig {
    /// The paper's network for `inputs` features and `outputs` state coordinates.
    pub fn paper(inputs: usize, outputs: usize, embedding: usize) -> Self {
        let (positions, architecture) = Default::default();
        Self {
            inputs,
            outputs,
            embedding,
            layers: 6,
            heads: 12,
            block: 32,
            history: 10,
            head: 64,
            positions,
            architecture,
        }
    }

    /// Tokens of a training sequence: the window, or `block` with rotary positions.
    pub fn sequence(&self) -> usize {
        match self.positions {
            Positions::Table => self.history,
            Positions::Rotary => self.block,
        }
    }

    /// Frames that a prediction depends on, the present one included: the window. With rotary positions, `history - 1`
    /// more for every layer, since a layer's cached keys and values depend on earlier tokens.
    pub fn reach(&self) -> usize {
        match (self.positions, self.architecture) {
            (Positions::Rotary, Architecture::Transformer) => self.layers * (self.history - 1) + 1,
            _ => self.history,
        }
    }

    /// Rotary angle (rad) of each column pair per token, `[d / 2]`; columns m and m + d/2 of a head form a pair.
    pub fn frequencies(&self) -> impl Iterator<Item = f64> {
        let half = self.embedding / self.heads / 2;
        (0..half).map(move |m| ROTARY_BASE.powf(-(m as f64) / half as f64))
    }

    /// Refuses an impossible shape, naming the key. An accepted shape has at most 2^30 parameters, so no count
    /// overflows and memory is bounded before any is allocated.
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
        // Within these bounds no product overflows.
        match self.parameters() {
            n if n > MOST_PARAMETERS => Err(format!("{n} parameters: at most {MOST_PARAMETERS} can be held")),
            _ => Ok(()),
        }
    }
}
