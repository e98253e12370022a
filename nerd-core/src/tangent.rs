//! The tangent space of a state `[q, qd]`, in which gradients are expressed: `2 nv` numbers `[pose, velocities]`, each
//! half laid out as `qd`, angular part first. A floating root has a rotation vector t (rad), a translation d (m), an
//! angular velocity a and a linear velocity b, all in its **body axes**: `R -> R exp(t)`, `x -> x + R d`, `a = R^-1 w`,
//! `b = R^-1 x_dot`. For joints the tangent is added to q and qd.

use nalgebra::Quaternion;

use crate::{dynamics::onto, frames::own_velocity, prelude::*, state::wrap_state};

/// Writes to `out` the state that is `change[2 nv]` away from `state`. To first order this inverts [`difference`].
pub fn moved(robot: &Robot, state: &[f64], change: &[f64], out: &mut [f64]) {
    let nq = robot.nq();
    let nv = robot.nv();
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    out.copy_from_slice(state);
    for i in 0..nv - dofs {
        out[coords + i] += change[dofs + i];
        out[nq + dofs + i] += change[nv + dofs + i];
    }
    if robot.floating() {
        let r = quaternion(&state[3..7]);
        let [a, b] = own_velocity(state, nq);
        let x = vector(state) + r * vector(&change[3..]);
        let turned = r * UnitQuaternion::from_scaled_axis(vector(change));
        let w = turned * (a + vector(&change[nv..]));
        let v = turned * (b + vector(&change[nv + 3..])) + x.cross(&w);
        out[..3].copy_from_slice(x.as_slice());
        write_quaternion(&mut out[3..7], &turned);
        out[nq..nq + 3].copy_from_slice(w.as_slice());
        out[nq + 3..nq + 6].copy_from_slice(v.as_slice());
    }
    wrap_state(robot, out);
}

/// Tangent `[2 nv]` from state `a` to state `b`: `[pose, velocities]`, each half laid out as `qd`. A floating root has
/// a rotation (twice the vector part of `a^-1 b`, rad), a translation (m) and differences of velocities. Each velocity
/// is in the body axes of its own state.
pub fn difference(robot: &Robot, a: &[f64], b: &[f64]) -> Vec<f64> {
    let nq = robot.nq();
    let nv = robot.nv();
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    let mut out = vec![0.0; 2 * nv];
    for (i, joint) in robot.joints().enumerate() {
        let turned = b[coords + i] - a[coords + i];
        out[dofs + i] = if joint.wraps() { wrap(turned) } else { turned };
        out[nv + dofs + i] = b[nq + dofs + i] - a[nq + dofs + i];
    }
    if robot.floating() {
        let r = quaternion(&a[3..7]);
        let (turn, sign) = turned(a, b);
        let ([a0, a1], [b0, b1]) = (own_velocity(a, nq), own_velocity(b, nq));
        let parts = [turn * (2.0 * sign), r.inverse_transform_vector(&(vector(b) - vector(a)))];
        out[..6].iter_mut().zip(parts.iter().flatten()).for_each(|(o, x)| *o = *x);
        out[nv..nv + 6].iter_mut().zip([b0 - a0, b1 - a1].iter().flatten()).for_each(|(o, x)| *o = *x);
    }
    out
}

/// Vector-Jacobian product of [`difference`] with respect to `b`. Adds the gradient with respect to `b` to `gradient[2
/// nv]`, given the gradient `upstream[2 nv]` with respect to the tangent.
pub fn difference_back(robot: &Robot, a: &[f64], b: &[f64], upstream: &[f64], gradient: &mut [f64]) {
    let first = if robot.floating() { 6 } else { 0 };
    let nv = robot.nv();
    let plain = (first..nv).chain(nv..2 * nv);
    plain.for_each(|k| gradient[k] += upstream[k]);
    if robot.floating() {
        let from = quaternion(&a[3..7]);
        let to = quaternion(&b[3..7]);
        let (turn, sign) = turned(a, b);
        let real = (from.inverse() * to).w * sign;
        let (by_turn, by_way) = (vector(upstream), vector(&upstream[3..]));
        let parts: [Vector3<f64>; 2] =
            [by_turn * real + by_turn.cross(&turn) * sign, to.inverse_transform_vector(&(from * by_way))];
        gradient.iter_mut().zip(parts.iter().flatten()).for_each(|(s, g)| *s += g);
    }
}

/// Converts `by`, the gradient with respect to the numbers `[q, qd]` of a state, to the tangent space. Adds the result
/// to `gradient[2 nv]`. Uses `w = R a` and `v = R b + x cross w`.
pub fn numbers_back(robot: &Robot, state: &[f64], by: &[f64], gradient: &mut [f64]) {
    let nq = robot.nq();
    let nv = robot.nv();
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    for i in 0..nv - dofs {
        gradient[dofs + i] += by[coords + i];
        gradient[nv + dofs + i] += by[nq + dofs + i];
    }
    if robot.floating() {
        let x = vector(state);
        let r = quaternion(&state[3..7]);
        let [a, b] = own_velocity(state, nq);
        let (by_w, by_v) = (vector(&by[nq..]), vector(&by[nq + 3..]));
        let [by_x, by_a, by_b] =
            [vector(by) + (r * a).cross(&by_v), by_w + by_v.cross(&x), by_v].map(|g| r.inverse_transform_vector(&g));
        let twist = (r.into_inner().conjugate() * raw_quaternion(&by[3..])).imag() * 0.5;
        let parts = [(0, twist + a.cross(&by_a) + b.cross(&by_b)), (3, by_x), (nv, by_a), (nv + 3, by_b)];
        parts.iter().for_each(|(at, g)| gradient[*at..at + 3].iter_mut().zip(g.iter()).for_each(|(s, g)| *s += g));
    }
}

/// The inverse of [`numbers_back`]: converts the tangent-space gradient `gradient[2 nv]` to the gradient with respect
/// to the numbers `[q, qd]`. The quaternion part is tangent to the unit sphere, as for a function that does not depend
/// on the quaternion's norm.
pub fn by_numbers(robot: &Robot, state: &[f64], gradient: &[f64]) -> Vec<f64> {
    let nq = robot.nq();
    let nv = robot.nv();
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    let mut out = vec![0.0; nq + nv];
    out[coords..nq].copy_from_slice(&gradient[dofs..nv]);
    out[nq + dofs..].copy_from_slice(&gradient[nv + dofs..]);
    if robot.floating() {
        let x = vector(state);
        let r = quaternion(&state[3..7]);
        let [a, b] = own_velocity(state, nq);
        let [by_turn, by_way, by_a, by_b] = [0, 3, nv, nv + 3].map(|at| vector(&gradient[at..]));
        let w = r * a;
        let by_v = r * by_b;
        let twist = r.into_inner() * Quaternion::from_imag(by_turn - a.cross(&by_a) - b.cross(&by_b)) * 2.0;
        out[..3].copy_from_slice((r * by_way + by_v.cross(&w)).as_slice());
        out[3..7].copy_from_slice(twist.coords.as_slice());
        out[nq..nq + 3].copy_from_slice((r * by_a + x.cross(&by_v)).as_slice());
        out[nq + 3..nq + 6].copy_from_slice(by_v.as_slice());
    }
    out
}

/// Adds a force (N, world axes) at a contact point to `loads[link]`, wrenches about the common origin. For a rim point
/// the moment about the disc's axis is removed, since the point does not rotate with the link about this axis.
pub fn push(data: &Data, point: &ContactPoint, event: &ContactEvent, force: Vector3<f64>, loads: &mut [Wrench]) {
    loads[point.link] += Wrench::force_at(force, &(event.p0 - data.origin));
    if let Locus::Rim { axis, .. } = &point.locus {
        let axis = data.rotation[point.link] * axis.as_ref();
        let arm = event.p0 - point_position(data, point.link, &point.local);
        loads[point.link].ang -= axis * axis.dot(&arm.cross(&force));
    }
}

/// Adds `J^T` times `loads[link]` (wrenches about the common origin) to the pose half of `gradient[2 nv]`. On return
/// each load is the sum over its link's subtree.
pub fn wrenches_back(robot: &Robot, data: &Data, loads: &mut [Wrench], gradient: &mut [f64]) {
    let mut along = vec![0.0; robot.nv()];
    onto(robot, data, loads, &mut along);
    if robot.floating() {
        let r = data.rotation[0];
        let x = data.position[0];
        let [moment, force] = [0, 3].map(|at| vector(&along[at..]));
        let parts = [r.tr_mul(&(moment - x.cross(&force))), r.tr_mul(&force)];
        along.iter_mut().zip(parts.iter().flatten()).for_each(|(a, part)| *a = *part);
    }
    gradient.iter_mut().zip(along).for_each(|(s, a)| *s += a);
}

/// The vector part of `a^-1 b`, with a and b the root quaternions, and the sign that selects the shorter rotation.
fn turned(a: &[f64], b: &[f64]) -> (Vector3<f64>, f64) {
    let turn = quaternion(&a[3..7]).inverse() * quaternion(&b[3..7]);
    (turn.imag(), if turn.w < 0.0 { -1.0 } else { 1.0 })
}
