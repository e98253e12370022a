//! The Ant runs forward, along world +x, as fast as it can (paper A.3.1.2). Frames, observation and action: [`crate::ant`].

use crate::ant::Ant;
use crate::body::Body;

/// The task.
pub const ANT_RUN: Ant = Ant { name: "ant-run", reward };

/// `R = v_x + 0.1 p_up + p_heading`, v in m/s.
fn reward(body: &Body) -> f64 {
    body.linear.x + 0.1 * body.up + body.heading
}
