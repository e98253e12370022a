//! Splits a planar joint into two slides and a hinge about the plane's normal, in that order. Two massless links lie
//! between the three joints. The split is exact, since the coordinates `(x, y, angle)` (m, m, rad) have no singularity.
//! A ball joint is refused, since any three angles for it have a singularity.

use nalgebra::Unit;

use super::{Bodies, BodyJoint, BodyJointKind};
use crate::prelude::*;

/// Suffix that names a planar joint's third part, the hinge that carries the child link.
pub(super) const TURN: &str = "turn";

/// Refuses a file that gives another joint or link the name of a planar joint's part.
pub(super) fn check_names(file: &Bodies) -> Result<(), UrdfError> {
    for planar in file.joints.iter().filter(|j| j.kind == BodyJointKind::Planar) {
        let given =
            |of: &str, name: &str| name.strip_prefix(of).is_some_and(|ending| [".x", ".y", ".turn"].contains(&ending));
        let joint = file.joints.iter().map(|j| &j.name).find(|name| given(&planar.name, name));
        let child = file.bodies.get(planar.child).map_or("", |child| &child.name);
        if let Some(taken) = joint.or_else(|| file.bodies.iter().map(|l| &l.name).find(|name| given(child, name))) {
            return Err(UrdfError::joint(
                &planar.name,
                format!("a planar joint makes a part `{taken}`, and the file has another of that name"),
            ));
        }
    }
    Ok(())
}

/// The parts of a planar joint: two sliding links, to be added as links `next` and `next + 1`, and the hinge that
/// carries `child`. `parent` is the moving link that carries the joint, and `origin` the pose of the joint's frame in
/// that link.
pub(super) fn planar(
    source: &BodyJoint,
    child: &str,
    parent: Option<usize>,
    origin: Isometry3<f64>,
    next: usize,
) -> ([Link; 2], Joint) {
    // Axes x and y of the plane: the joint frame's, rotated so that z lies along the normal.
    let tilt = rotation_from(&Vector3::z_axis(), &source.axis);
    let part = |word: &str, kind: JointKind, at: Isometry3<f64>, axis: Unit<Vector3<f64>>| {
        let mut joint = Joint::new(format!("{}.{word}", source.name), kind, at, axis);
        (joint.damping, joint.friction) = (source.damping, source.friction);
        joint
    };
    let slide = |word: &str, parent, at, axis| {
        let joint = Some(part(word, JointKind::Prismatic, at, axis));
        Link::new(format!("{child}.{word}"), parent, joint, BodyInertia::default())
    };
    let same = Isometry3::identity();
    let links =
        [slide("x", parent, origin, tilt * Vector3::x_axis()), slide("y", Some(next), same, tilt * Vector3::y_axis())];
    (links, part(TURN, JointKind::Continuous, same, source.axis))
}
