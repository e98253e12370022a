//! NeRD and the designs that the paper compares it with (A.3.3): each is NeRD with one decision taken back.

use nerd_model::base::Base;
use nerd_model::form::{Form, View};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{Architecture, TransformerConfig};
use serde::{Deserialize, Serialize};

use crate::error::{Result, refuse};

/// A design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The paper's design.
    #[default]
    Nerd,
    /// A perceptron of the present token alone.
    Mlp,
    /// Gated recurrent units in place of the Transformer.
    Gru,
    /// Long short-term memory in place of the Transformer.
    Lstm,
    /// State and torques in world axes to the next state; contacts unseen.
    EndToEnd,
    /// Predicts the next state in place of the change.
    Absolute,
    /// State and contacts in world axes.
    World,
    /// Rods of a chain as tokens, learned through many frames ([`crate::unroll`]).
    Chain,
    /// Inputs as they are.
    RawInputs,
    /// Targets as they are.
    RawOutputs,
}

impl Variant {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["nerd", "mlp", "gru", "lstm", "end-to-end", "absolute", "world", "chain", "raw-inputs", "raw-outputs"];

    /// Whether it is NeRD itself.
    pub fn usual(&self) -> bool {
        *self == Self::Nerd
    }

    /// In a title.
    pub fn name(self) -> String {
        match self {
            Self::Nerd => "NeRD".into(),
            Self::Chain => "NeRD along the chain".into(),
            rival => format!("NeRD's rival {rival:?}"),
        }
    }

    /// Refuses what would be two decisions at once.
    pub fn check(self, Form { base, view }: Form) -> Result<()> {
        if view == View::Moving && matches!(self, Self::Absolute | Self::EndToEnd | Self::World | Self::Chain) {
            refuse!("--view moving is one more decision than --variant absolute, end-to-end, world or chain: leave it out");
        }
        if base == Base::Trapezoid && matches!(self, Self::Absolute | Self::EndToEnd | Self::World | Self::RawOutputs) {
            refuse!(
                "--base trapezoid goes with the robot's own velocities: and scales positions by them: leave --variant absolute, end-to-end, world and raw-outputs out"
            );
        }
        Ok(())
    }

    /// What its tokens hold and what its predictions mean, of a run's `form`.
    pub fn form(self, Form { base, view }: Form) -> Form {
        let (base, view) = match self {
            Self::EndToEnd => (Base::Nothing, View::Blind),
            Self::Absolute => (Base::Nothing, View::Own),
            Self::World => (base, View::World),
            _ => (base, view),
        };
        Form { base, view }
    }

    /// Its network beside NeRD's `nerd`: of another architecture the widest with no more parameters.
    pub fn network(self, nerd: TransformerConfig) -> TransformerConfig {
        let architecture = match self {
            Self::Mlp => Architecture::Mlp,
            Self::Gru => Architecture::Gru,
            Self::Lstm => Architecture::Lstm,
            _ => return nerd,
        };
        let history = if self == Self::Mlp { 1 } else { nerd.history };
        let of = |embedding| TransformerConfig { architecture, embedding, heads: 1, block: history, history, ..nerd };
        let wider = (1..=4096).map(of).take_while(|c| c.parameters() <= nerd.parameters());
        wider.last().unwrap_or(of(1))
    }

    /// Its normaliser, given the data's.
    pub fn normalizer(self, mut data: Normalizer) -> Normalizer {
        match self {
            Self::RawInputs => data.inputs = Moments::identity(data.inputs.mean.len()),
            Self::RawOutputs => data.outputs = Moments::identity(data.outputs.mean.len()),
            _ => {}
        }
        data
    }
}
