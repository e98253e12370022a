//! The trapezoid base: predicted positions are corrections to motion at the mean of the velocities before and after the
//! frame.
//!
//! With present velocities `v`, predicted changes `c_v` and correction `c`, over a frame of time T:
//! `dq = T (v + c_v / 2) + c`. For a free root (body axes, `a` angular and `b` linear) `d = T (b + c_b / 2) + c_d`, and
//! its rotation is `exp(T (a + c_a / 2)) c_n`. So positions follow velocities, and only the effect of contact within
//! the frame is left to learn.

use nerd_core::frames::own_velocity;

use crate::normalizer::Moments;
use crate::prelude::*;

/// Rotation vector (rad) and translation (m) of a free root over a frame at its mean velocities, in body axes.
fn carried(robot: &Robot, time: f64, state: &[f64], change: &[f64]) -> [Vector3<f64>; 2] {
    let nq = robot.nq();
    let [a, b] = own_velocity(state, robot.nq());
    [(a + vector(&change[nq..]) * 0.5) * time, (b + vector(&change[nq + 3..]) * 0.5) * time]
}

/// Sets the scale of position corrections to the scale of velocity changes times the frame time. So the tiny correction
/// of smooth motion uses no capacity of the network.
pub fn level(robot: &Robot, time: f64, outputs: &mut Moments) {
    let nq = robot.nq();
    let coords = robot.root_coords();
    let dofs = robot.root_dofs();
    let of = |velocity: usize, share: f64| (share * time, nq + velocity);
    // A rotation's quaternion changes by half its angle.
    let root = [of(3, 1.0), of(4, 1.0), of(5, 1.0), of(0, 0.5), of(1, 0.5), of(2, 0.5), of(0, 0.5)];
    let pairs = root.into_iter().take(coords).chain((0..robot.joint_count()).map(|i| of(dofs + i, 1.0)));
    for (k, (share, velocity)) in pairs.enumerate() {
        outputs.variance[k] =
            (share * share * (outputs.variance[velocity] + outputs.epsilon) - outputs.epsilon).max(0.0);
    }
}

/// Converts a prediction to the change of the state, in place (`sign` 1), or back (-1).
pub fn carry(robot: &Robot, time: f64, state: &[f64], change: &mut [f64], sign: f64) {
    let nq = robot.nq();
    let coords = robot.root_coords();
    let dofs = robot.root_dofs();
    for i in 0..robot.joint_count() {
        change[coords + i] += sign * time * (state[nq + dofs + i] + 0.5 * change[nq + dofs + i]);
    }
    if robot.floating() {
        let [u, way] = carried(robot, time, state, change);
        let turned = UnitQuaternion::from_scaled_axis(u * sign).into_inner() * raw_quaternion(&change[3..]);
        change[..3].iter_mut().zip(way.iter()).for_each(|(x, d)| *x += sign * d);
        change[3..7].copy_from_slice(turned.coords.as_slice());
    }
}

/// Adjoint of [`carry`] with sign 1. `by` is the gradient with respect to the change on entry, and with respect to the
/// prediction on return. Adds the gradient with respect to the state (tangent space, [`crate::gradients`]) to
/// `gradient[2 nv]`.
pub fn back(robot: &Robot, time: f64, state: &[f64], prediction: &[f64], by: &mut [f64], gradient: &mut [f64]) {
    let nq = robot.nq();
    let nv = robot.nv();
    let coords = robot.root_coords();
    let dofs = robot.root_dofs();
    for i in 0..robot.joint_count() {
        gradient[nv + dofs + i] += time * by[coords + i];
        by[nq + dofs + i] += 0.5 * time * by[coords + i];
    }
    if !robot.floating() {
        return;
    }
    let u = carried(robot, time, state, prediction)[0];
    let by_way = vector(by);
    let e = UnitQuaternion::from_scaled_axis(u).into_inner();
    let by_turn = raw_quaternion(&by[3..]);
    let by_own = e.conjugate() * by_turn;
    let twist = (by_own * raw_quaternion(&prediction[3..]).conjugate()).imag() * 0.5;
    // With respect to the rotation vector: the transposed right Jacobian of exp.
    let angle = u.norm();
    let (first, second) = if angle > 1e-4 {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3))
    } else {
        (0.5, 1.0 / 6.0)
    };
    let once = u.cross(&twist);
    let by_u = twist + once * first + u.cross(&once) * second;
    by[3..7].copy_from_slice(by_own.coords.as_slice());
    for (at, g) in [(0, by_u), (3, by_way)] {
        for k in 0..3 {
            gradient[nv + at + k] += time * g[k];
            by[nq + at + k] += 0.5 * time * g[k];
        }
    }
}
