//! What a run's network moves: a robot, or a cable rod by rod.

use serde::{Deserialize, Serialize};

/// A design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The paper's: a token of the whole robot a frame.
    #[default]
    Nerd,
    /// Rods of a chain as tokens, learned through many frames ([`crate::unroll`]).
    Chain,
}

impl Variant {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["nerd", "chain"];

    /// Whether it is NeRD itself.
    pub fn usual(&self) -> bool {
        *self == Self::Nerd
    }

    /// In a title.
    pub fn name(self) -> &'static str {
        if self == Self::Chain { "NeRD along the chain" } else { "NeRD" }
    }
}
