//! The base to which a prediction is added. No dynamics are computed for it: the network does all the work.

use serde::{Deserialize, Serialize};

/// The base to which a prediction is added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The state before the frame: the paper's form.
    #[default]
    State,
    /// The state; positions count from the trapezoid rule's, at the mean of the velocities before and after ([`crate::trapezoid`]).
    Trapezoid,
}
