//! Helpers over states `[q, qd]` (layout in [`crate::robot::Robot`]).

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::robot::Robot;

/// Wraps an angle to [-pi, pi), whole turns of `2.0 * PI` taken away without rounding. Not a number for what is not finite;
/// an angle beyond 1e15 rad is in range, but its place in the turn was lost to rounding before it came here.
#[inline]
pub fn wrap(x: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if (-PI..PI).contains(&x) {
        return x;
    }
    let y = x % TAU;
    if y >= PI {
        y - TAU
    } else if y < -PI {
        y + TAU
    } else {
        y
    }
}

/// Wraps every endless joint angle of one state in place, see [`crate::robot::Joint::wraps`].
#[inline]
pub fn wrap_state(robot: &Robot, state: &mut [f64]) {
    for (joint, q) in robot.joints().zip(&mut state[robot.root_coords()..]) {
        if joint.wraps() {
            *q = wrap(*q);
        }
    }
}

/// Reads three coordinates.
#[inline]
pub fn vector(x: &[f64]) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}

/// Reads `x y z w` and normalises.
#[inline]
pub fn quaternion(x: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(x[3], x[0], x[1], x[2]))
}

/// Writes `x y z w`.
#[inline]
pub fn write_quaternion(out: &mut [f64], q: &UnitQuaternion<f64>) {
    out[..4].copy_from_slice(q.coords.as_slice());
}
