//! What tasks of the Ant and of ANYmal see of a floating root. World up is +y, forward is +x, +z is to the right.

use nalgebra::{UnitQuaternion, Vector3};
use nerd_core::state::{quaternion, vector};

/// Pose and velocity of a floating root in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Height of its origin (m).
    pub height: f64,
    /// Orientation, body to world.
    pub orientation: UnitQuaternion<f64>,
    /// Velocity of its origin `p_dot = v + w x p` (m/s), v the linear part of the state's twist about the world origin.
    pub linear: Vector3<f64>,
    /// Angular velocity (rad/s).
    pub angular: Vector3<f64>,
    /// World-y component of the body's z axis, 1 when upright.
    pub up: f64,
    /// World-x component of the body's x axis, 1 when facing forward.
    pub heading: f64,
}

impl Body {
    /// The root of a state `[q, qd]` whose `q` has `nq` numbers.
    pub fn of(state: &[f64], nq: usize) -> Self {
        let (p, orientation) = (vector(state), quaternion(&state[3..7]));
        let (angular, v) = (vector(&state[nq..]), vector(&state[nq + 3..]));
        Self {
            height: p.y,
            orientation,
            linear: v + angular.cross(&p),
            angular,
            up: (orientation * Vector3::z()).y,
            heading: (orientation * Vector3::x()).x,
        }
    }
}

/// The observation of both robots, `13 + 2 k` numbers for k joints: height, quaternion x y z w, velocity, angular velocity,
/// joint positions, joint velocities, up, heading. The world position and time are not in it.
pub fn observe(state: &[f64], nq: usize, out: &mut [f64]) {
    let (body, k) = (Body::of(state, nq), nq - 7);
    out[0] = body.height;
    out[1..5].copy_from_slice(&state[3..7]);
    out[5..8].copy_from_slice(body.linear.as_slice());
    out[8..11].copy_from_slice(body.angular.as_slice());
    out[11..11 + k].copy_from_slice(&state[7..nq]);
    out[11 + k..11 + 2 * k].copy_from_slice(&state[nq + 6..]);
    out[11 + 2 * k] = body.up;
    out[12 + 2 * k] = body.heading;
}
