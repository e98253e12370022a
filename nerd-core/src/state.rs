//! Operations on states `[q, qd]` (layout in [`crate::robot::Robot`]): angle wrapping, integration and difference on
//! the manifold.

use std::f64::consts::{PI, TAU};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::robot::Robot;

/// Wraps an angle (rad) to [-pi, pi) by removing whole turns of `2.0 * PI` without rounding. Returns NaN for an angle
/// that is not finite. Beyond 1e15 rad the result is in range but meaningless, since the angle's rounding exceeds a
/// turn.
#[inline]
pub fn wrap(x: f64) -> f64 {
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

/// Wraps, in place, the angles of one state's hinges that have neither limits nor a spring
/// ([`crate::robot::Joint::wraps`]).
#[inline]
pub fn wrap_state(robot: &Robot, state: &mut [f64]) {
    for (joint, q) in robot.joints().zip(&mut state[robot.root_coords()..]) {
        if joint.wraps() {
            *q = wrap(*q);
        }
    }
}

/// Moves coordinates `q[nq]` along a tangent `v[nv]`: a velocity in the local form times one second
/// ([`crate::dynamics::to_local`]). A floating root rotates by the rotation vector `v[..3]` (rad) and translates by
/// `v[3..6]` (m), both in world axes. Joint coordinates add their entry of `v`. Angles of hinges with neither limits
/// nor a spring are wrapped.
pub fn integrate(robot: &Robot, q: &[f64], v: &[f64], out: &mut [f64]) {
    out.copy_from_slice(q);
    if robot.floating() {
        let turned = UnitQuaternion::from_scaled_axis(vector(v)) * quaternion(&q[3..7]);
        write_quaternion(&mut out[3..7], &turned);
        (0..3).for_each(|k| out[k] += v[3 + k]);
    }
    out[robot.root_coords()..].iter_mut().zip(&v[robot.root_dofs()..]).for_each(|(q, v)| *q += v);
    wrap_state(robot, out);
}

/// Writes the shortest tangent `out[nv]` (rad, m) from coordinates `a[nq]` to `b[nq]`: the inverse of [`integrate`].
pub fn difference(robot: &Robot, a: &[f64], b: &[f64], out: &mut [f64]) {
    if robot.floating() {
        let turn = (quaternion(&b[3..7]) * quaternion(&a[3..7]).inverse()).scaled_axis();
        out[..3].copy_from_slice(turn.as_slice());
        (0..3).for_each(|k| out[3 + k] = b[k] - a[k]);
    }
    let (coords, dofs) = (robot.root_coords(), robot.root_dofs());
    for (i, joint) in robot.joints().enumerate() {
        let d = b[coords + i] - a[coords + i];
        out[dofs + i] = if joint.wraps() { wrap(d) } else { d };
    }
}

/// The first three numbers of `x`.
#[inline]
pub fn vector(x: &[f64]) -> Vector3<f64> {
    Vector3::new(x[0], x[1], x[2])
}

/// Reads a quaternion `x y z w` and normalises it.
#[inline]
pub fn quaternion(x: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(raw_quaternion(x))
}

/// Reads a quaternion `x y z w` of any norm.
#[inline]
pub fn raw_quaternion(x: &[f64]) -> Quaternion<f64> {
    Quaternion::new(x[3], x[0], x[1], x[2])
}

/// Writes a quaternion as `x y z w`.
#[inline]
pub fn write_quaternion(out: &mut [f64], q: &UnitQuaternion<f64>) {
    out[..4].copy_from_slice(q.coords.as_slice());
}
