//! What a prediction is added to. Nothing is computed for it: the network does the work alone.

use serde::{Deserialize, Serialize};

/// What a prediction is added to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The state before the frame: the paper's form.
    #[default]
    State,
    /// The state; positions count from where the mean of the velocities before and after would go ([`crate::trapezoid`]).
    Trapezoid,
}
