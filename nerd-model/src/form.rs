//! The form of tokens and predictions: the paper's, or with more motion features. A model carries its form.

use serde::{Deserialize, Serialize};

use crate::base::Base;

/// Content of a token, all in the robot's root frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// State, contacts, torques and gravity (paper A.1).
    #[default]
    Own,
    /// The content of [`View::Own`], and velocities and nearness of contact points, axes of links, sine and cosine of
    /// every angle.
    Moving,
}

/// Content of tokens and meaning of predictions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Form {
    /// The base to which predictions are added.
    pub base: Base,
    /// Content of tokens.
    pub view: View,
    /// Whether tokens are conditioned on the robot's drawn parameters ([`nerd_sim::vary::Told`]).
    pub told: bool,
}

impl From<Base> for Form {
    /// `base` with the paper's tokens.
    fn from(base: Base) -> Self {
        Self { base, ..Self::default() }
    }
}
