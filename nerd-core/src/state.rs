//! Helpers over states `[q, qd]` (layout in [`crate::robot::Robot`]).

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::robot::Robot;

/// Wraps an angle to [-pi, pi): `x - 2 pi floor((x + pi) / 2 pi)`.
#[inline]
pub fn wrap(x: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if (-PI..PI).contains(&x) {
        return x;
    }
    // Rounding may land on either side of the seam.
    let y = x - TAU * ((x + PI) / TAU).floor();
    if y >= PI { (y - TAU).max(-PI) } else { y.max(-PI) }
}

/// Wraps every endless joint angle of one state in place.
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
