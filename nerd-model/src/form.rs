//! The form of inputs and predictions: the paper's (own frame, changes of state), or an ablation of it (paper A.3.3). A model carries its
//! form, so an ablated one is evaluated by the same code.

use serde::{Deserialize, Serialize};

use crate::base::Base;

/// Where a token is seen from, and whether it holds the surroundings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum View {
    /// The robot's own frame (paper A.1).
    #[default]
    Own,
    /// The robot's own frame; every angle enters as sine and cosine, too, contact points with their velocities and how near they are.
    Moving,
    /// World axes and origin, for states, contacts, gravity and targets alike: the paper's equation 1.
    World,
    /// World axes and origin, and nothing but state and torques: the paper's end-to-end baseline.
    Blind,
}

/// What tokens hold and what predictions mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Form {
    /// What predictions are added to.
    pub base: Base,
    /// Where tokens are seen from.
    pub view: View,
}

impl View {
    /// Whether all is seen from the robot's own frame.
    pub fn own(self) -> bool {
        matches!(self, Self::Own | Self::Moving)
    }
}

impl From<Base> for Form {
    /// Seen from the robot's own frame.
    fn from(base: Base) -> Self {
        Self { base, ..Self::default() }
    }
}
