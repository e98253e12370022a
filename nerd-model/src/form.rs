//! The form of inputs and predictions: the paper's, or with more that moves. A model carries its form.

use serde::{Deserialize, Serialize};

use crate::base::Base;

/// What a token holds, all in the robot's own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// State, contacts, torques and gravity (paper A.1).
    #[default]
    Own,
    /// Also velocities of contact points and how near they are, axes of links, sine and cosine of every angle.
    Moving,
}

/// What tokens hold and what predictions mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Form {
    /// What predictions are added to.
    pub base: Base,
    /// What tokens hold.
    pub view: View,
    /// Whether they end with what was drawn of their robot ([`nerd_sim::vary::Told`]).
    pub told: bool,
}

impl From<Base> for Form {
    /// With the paper's tokens.
    fn from(base: Base) -> Self {
        Self { base, ..Self::default() }
    }
}
