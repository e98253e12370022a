//! The Ant spins about world +y at 5 rad/s (paper A.3.1.2). Frames, observation and action: [`crate::ant`].

use crate::ant::Ant;
use crate::body::Body;

/// The task.
pub const ANT_SPIN_TRACK: Ant = Ant { name: "ant-spin-track", reward };

/// `R = 5 exp(-(w_y - 5)^2 - 0.1 w_x^2 - 0.1 w_z^2) + 0.1 p_up`, w in rad/s.
fn reward(body: &Body) -> f64 {
    let w = body.angular;
    5.0 * (-(w.y - 5.0).powi(2) - 0.1 * w.x * w.x - 0.1 * w.z * w.z).exp() + 0.1 * body.up
}
