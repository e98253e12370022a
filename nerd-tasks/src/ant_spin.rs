//! The Ant spins about world +y as fast as it can (paper A.3.1.2). Frames, observation and action: [`crate::ant`].

use crate::ant::Ant;
use crate::body::Body;

/// The task.
pub const ANT_SPIN: Ant = Ant { name: "ant-spin", reward };

/// `R = w_y + p_up`, w in rad/s.
fn reward(body: &Body) -> f64 {
    body.angular.y + body.up
}
