//! Forward kinematics: link frames and joint axes from `q`; spatial inertias of the links.

use nalgebra::{Rotation3, Translation3};

use crate::{prelude::*, velocity::root_position};

/// Fills `rotation`, `position` and `axis` of every link for coordinates `q` (length `nq`), with the common origin at
/// the root.
#[inline]
pub fn kinematics(robot: &Robot, q: &[f64], data: &mut Data) {
    kinematics_about(robot, q, &root_position(robot, q), data);
}

/// Like [`kinematics`], with the common origin at the world position `origin` (m).
#[inline]
pub fn kinematics_about(robot: &Robot, q: &[f64], origin: &Vector3<f64>, data: &mut Data) {
    data.origin = *origin;
    let base = root_position(robot, q) - origin;
    let root = root_rotation(robot, q);
    let joints = &q[robot.root_coords()..];
    let dofs = robot.root_dofs();
    let first = usize::from(robot.floating());
    if robot.floating() {
        data.rotation[0] = root;
        data.position[0] = base;
    }
    for (i, link) in robot.links.iter().enumerate().skip(first) {
        let Some(joint) = &link.joint else { continue };
        let (parent, start) = match link.parent {
            Some(p) => (&data.rotation[p], data.position[p]),
            None => (&root, base),
        };
        let value = match joint.mimic() {
            None => joints[data.dof[i] - dofs],
            Some(mimic) => mimic.multiplier * joints[mimic.coordinate] + mimic.offset,
        };
        let (rotation, position) = hung(joint, value, parent, start, &mut data.axis[i]);
        data.rotation[i] = rotation;
        data.position[i] = position;
    }
}

/// Rotation and position (m) of a link, from those of its parent (`parent`, `start`) and the joint position `value`
/// (rad or m). Writes the joint axis per unit rate of the joint's coordinate to `motion`.
#[inline(always)]
pub(super) fn hung(
    joint: &Joint,
    value: f64,
    parent: &Matrix3<f64>,
    start: Vector3<f64>,
    motion: &mut Motion,
) -> (Matrix3<f64>, Vector3<f64>) {
    let turn = joint.turn();
    let mut position = start + parent * joint.origin().translation.vector;
    let rotation = match joint.kind {
        JointKind::Prismatic => parent * (turn[0] + turn[2]),
        _ => {
            let (sin, cos) = value.sin_cos();
            parent * (turn[0] + turn[1] * sin + turn[2] * cos)
        }
    };
    // The rotation by q about the axis leaves the axis unchanged.
    let axis = rotation * joint.axis().into_inner();
    *motion = match joint.kind {
        JointKind::Prismatic => {
            position += axis * value;
            Motion::new(Vector3::zeros(), axis)
        }
        _ => Motion::new(axis, position.cross(&axis)),
    };
    if let Some(mimic) = joint.mimic() {
        *motion = *motion * mimic.multiplier;
    }
    (rotation, position)
}

/// Fills `data.inertia[link]`, about the common origin. Needs [`kinematics`].
pub fn inertias(robot: &Robot, data: &mut Data) {
    for (i, link) in robot.links.iter().enumerate() {
        data.inertia[i] = SpatialInertia::of(&link.inertia, &data.rotation[i], &data.position[i]);
    }
}

/// World pose of a link. Needs [`kinematics`].
pub fn link_pose(data: &Data, link: usize) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(data.rotation[link]));
    Isometry3::from_parts(Translation3::from(data.origin + data.position[link]), rotation)
}

/// World position (m) of a point fixed at `local` (m, link frame) on a link. Needs [`kinematics`].
#[inline]
pub fn point_position(data: &Data, link: usize, local: &Vector3<f64>) -> Vector3<f64> {
    data.origin + data.position[link] + data.rotation[link] * local
}

#[inline]
pub(super) fn root_rotation(robot: &Robot, q: &[f64]) -> Matrix3<f64> {
    match robot.base {
        Base::Fixed(pose) => pose.rotation.to_rotation_matrix().into_inner(),
        Base::Floating => quaternion(&q[3..7]).to_rotation_matrix().into_inner(),
    }
}
