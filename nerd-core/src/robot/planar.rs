//! Planar joints of a URDF: two slides and a turn about the normal, in that order, through two links that weigh nothing. The coordinates
//! `(x, y, angle)` have no singularity, so this is exact. (Any three angles of a ball joint have one; it is refused.)

use nalgebra::Unit;
use urdf_rs::JointType;

use super::lump::{axis, losses};
use crate::prelude::*;

/// Ending of the name of the last joint, which carries the child link.
pub(super) const TURN: &str = "turn";

/// Refuses a file in which another joint or link has a name that a planar joint gives to a part of its own.
pub(super) fn check_names(file: &urdf_rs::Robot) -> Result<(), UrdfError> {
    for planar in file.joints.iter().filter(|j| j.joint_type == JointType::Planar) {
        let given = |of: &str, name: &str| name.strip_prefix(of).is_some_and(|ending| [".x", ".y", ".turn"].contains(&ending));
        let joint = file.joints.iter().map(|j| &j.name).find(|name| given(&planar.name, name));
        if let Some(taken) = joint.or_else(|| file.links.iter().map(|l| &l.name).find(|name| given(&planar.child.link, name))) {
            return Err(UrdfError::joint(
                &planar.name,
                format!("a planar joint makes a part `{taken}`, and the file has another of that name"),
            ));
        }
    }
    Ok(())
}

/// The two sliding links of a planar joint, which are to be added as links `next` and `next + 1`, and the joint that turns `child` on the
/// second. `parent` is the moving link that carries the joint, and `origin` the joint's frame in it.
pub(super) fn planar(
    source: &urdf_rs::Joint,
    child: &str,
    parent: Option<usize>,
    origin: Isometry3<f64>,
    next: usize,
    notes: &mut Vec<String>,
) -> Result<([Link; 2], Joint), UrdfError> {
    let wrong = |reason: &str| UrdfError::joint(&source.name, reason);
    if source.mimic.is_some() {
        return Err(wrong("a planar joint has three coordinates, and none of them can follow by <mimic>"));
    }
    let limit = &source.limit;
    if [limit.lower, limit.upper, limit.effort, limit.velocity].iter().any(|x| *x != 0.0) {
        notes.push(format!("joint `{}`: <limit> is passed over, since a planar joint has three coordinates", source.name));
    }
    let normal = axis(source)?;
    // The plane's axes x and y: those of the joint's frame, turned with z to the normal.
    let tilt = UnitQuaternion::rotation_between(&Vector3::z(), &normal)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let (damping, friction) = losses(source)?;
    let part = |word: &str, kind: JointKind, at: Isometry3<f64>, axis: Unit<Vector3<f64>>| {
        let mut joint = Joint::new(format!("{}.{word}", source.name), kind, at, axis);
        (joint.damping, joint.friction) = (damping, friction);
        joint
    };
    let slide = |word: &str, parent, at, axis| {
        let joint = Some(part(word, JointKind::Prismatic, at, axis));
        Link { name: format!("{child}.{word}"), parent, joint, inertia: BodyInertia::default(), shapes: Vec::new() }
    };
    let same = Isometry3::identity();
    let links = [slide("x", parent, origin, tilt * Vector3::x_axis()), slide("y", Some(next), same, tilt * Vector3::y_axis())];
    Ok((links, part(TURN, JointKind::Continuous, same, normal)))
}
