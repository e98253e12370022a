//! The base to which a prediction is added. The base involves no dynamics: the network predicts all of the dynamics.

use serde::{Deserialize, Serialize};

/// The base to which a prediction is added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The state before the frame (paper).
    #[default]
    State,
    /// The state before the frame, with positions advanced by the mean of the velocities before and after the frame
    /// ([`crate::trapezoid`]).
    Trapezoid,
}
