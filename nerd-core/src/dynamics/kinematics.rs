//! Forward kinematics: link frames, joint axes and, for those who need them, inertias about the root, from `q`.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::Data;
use crate::robot::{Base, JointKind, Robot};
use crate::spatial::{Motion, SpatialInertia};
use crate::state::{quaternion, vector};

/// Fills `rotation`, `position` and `axis` of every link for coordinates `q` (length `nq`).
#[inline]
pub fn kinematics(robot: &Robot, q: &[f64], data: &mut Data) {
    let root = root_rotation(robot, q);
    let joints = &q[robot.root_coords()..];
    let first = usize::from(robot.floating());
    if robot.floating() {
        data.rotation[0] = root;
        data.position[0] = Vector3::zeros();
    }
    for (i, link) in robot.links.iter().enumerate().skip(first) {
        let Some(joint) = &link.joint else { continue };
        let (parent, start) = match link.parent {
            Some(p) => (&data.rotation[p], data.position[p]),
            None => (&root, Vector3::zeros()),
        };
        let value = joints[i - first];
        let mut position = start + parent * joint.origin.translation.vector;
        let rotation = match joint.kind {
            JointKind::Prismatic => parent * (joint.turn[0] + joint.turn[2]),
            _ => {
                let (sin, cos) = value.sin_cos();
                parent * (joint.turn[0] + joint.turn[1] * sin + joint.turn[2] * cos)
            }
        };
        // The axis is the same before and after turning about itself.
        let axis = rotation * joint.axis.into_inner();
        data.axis[i] = match joint.kind {
            JointKind::Prismatic => {
                position += axis * value;
                Motion::new(Vector3::zeros(), axis)
            }
            _ => Motion::new(axis, position.cross(&axis)),
        };
        data.rotation[i] = rotation;
        data.position[i] = position;
    }
}

/// Fills `inertia` of every link, about the root; after [`kinematics`].
pub fn inertias(robot: &Robot, data: &mut Data) {
    for (i, link) in robot.links.iter().enumerate() {
        data.inertia[i] = SpatialInertia::of(&link.inertia, &data.rotation[i], &data.position[i]);
    }
}

/// World pose of a link after [`kinematics`]; `q` gives the root's place.
pub fn link_pose(robot: &Robot, q: &[f64], data: &Data, link: usize) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(data.rotation[link]));
    Isometry3::from_parts(Translation3::from(root_position(robot, q) + data.position[link]), rotation)
}

/// World position of a point fixed at `local` on a link, after [`kinematics`]; of the root itself for a link index
/// past the last.
#[inline]
pub fn point_position(robot: &Robot, q: &[f64], data: &Data, link: usize, local: &Vector3<f64>) -> Vector3<f64> {
    let root = root_position(robot, q);
    if link < data.position.len() { root + data.position[link] + data.rotation[link] * local } else { root }
}

/// Where the common origin is in the world (m).
#[inline]
pub(crate) fn root_position(robot: &Robot, q: &[f64]) -> Vector3<f64> {
    match robot.base {
        Base::Fixed(pose) => pose.translation.vector,
        Base::Floating => vector(&q[..3]),
    }
}

#[inline]
fn root_rotation(robot: &Robot, q: &[f64]) -> Matrix3<f64> {
    match robot.base {
        Base::Fixed(pose) => pose.rotation.to_rotation_matrix().into_inner(),
        Base::Floating => quaternion(&q[3..7]).to_rotation_matrix().into_inner(),
    }
}

/// Turns a floating root's twist about the world origin into `(w, p_dot)`: `p_dot = v + w x p`.
#[inline]
pub fn to_local(robot: &Robot, q: &[f64], qd: &mut [f64]) {
    shift(robot, q, qd, 1.0);
}

/// The inverse of [`to_local`]: `v = p_dot - w x p`.
#[inline]
pub fn to_world(robot: &Robot, q: &[f64], qd: &mut [f64]) {
    shift(robot, q, qd, -1.0);
}

#[inline]
fn shift(robot: &Robot, q: &[f64], qd: &mut [f64], sign: f64) {
    if robot.floating() {
        let moved = vector(&qd[3..6]) + vector(&qd[..3]).cross(&vector(&q[..3])) * sign;
        qd[3..6].copy_from_slice(moved.as_slice());
    }
}
