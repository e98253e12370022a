//! Observations of a free base for the tasks of Ant and ANYmal. World up is +y, forward is +x, +z is to the right.

use crate::formula::{Number, Sight};

/// Pose and velocity of a floating root in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body<N> {
    /// Height of its origin (m).
    pub height: N,
    /// Velocity of its origin `p_dot = v + w x p` (m/s), v the linear part of the state's twist about the world origin.
    pub linear: [N; 3],
    /// Angular velocity (rad/s).
    pub angular: [N; 3],
    /// World-y component of the body's z axis, 1 when upright.
    pub up: N,
    /// World-x component of the body's x axis, 1 when facing forward.
    pub heading: N,
}

impl<N: Number> Body<N> {
    /// The root that is seen.
    pub fn of(sight: &impl Sight<N>) -> Self {
        let (p, [w, v]) = ([0, 1, 2].map(|k| sight.q(k)), [0, 3].map(|at| [0, 1, 2].map(|k| sight.qd(at + k))));
        let cross = |i: usize| w[(i + 1) % 3] * p[(i + 2) % 3] - w[(i + 2) % 3] * p[(i + 1) % 3];
        // The state's quaternion need not be of unit length.
        let [x, y, z, c] = [3, 4, 5, 6].map(|k| sight.q(k));
        let (one, two) = (x.squared() + y.squared() + z.squared() + c.squared(), N::from(2.0));
        Self {
            height: p[1],
            linear: [0, 1, 2].map(|i| v[i] + cross(i)),
            angular: w,
            up: two * (y * z - c * x) / one,
            heading: N::from(1.0) - two * (y.squared() + z.squared()) / one,
        }
    }
}

/// The observation of both robots, `13 + 2 k` numbers for k joints: height, quaternion x y z w, velocity, angular velocity,
/// joint positions, joint velocities, up, heading. The world position and time are not in it.
pub fn observe<N: Number>(sight: &impl Sight<N>, out: &mut [N]) {
    let (body, k) = (Body::of(sight), (out.len() - 13) / 2);
    out[0] = body.height;
    (0..4).for_each(|i| out[1 + i] = sight.q(3 + i));
    out[5..8].copy_from_slice(&body.linear);
    out[8..11].copy_from_slice(&body.angular);
    for i in 0..k {
        (out[11 + i], out[11 + k + i]) = (sight.q(7 + i), sight.qd(6 + i));
    }
    (out[11 + 2 * k], out[12 + 2 * k]) = (body.up, body.heading);
}
