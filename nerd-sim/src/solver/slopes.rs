//! Slopes of a frame.

/// What [`super::Solver::back`] finds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Slopes {
    /// States after the frame, `[env][q, qd]`.
    pub next: Vec<f64>,
    /// Gradients by the states before it, `[env][row][2 nv]`.
    pub states: Vec<f64>,
    /// Gradients by the torques, `[env][row][joint]`.
    pub torques: Vec<f64>,
}
