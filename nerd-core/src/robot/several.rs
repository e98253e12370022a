//! Joints of a URDF with more than one DoF, where coordinates of one DoF represent them exactly.
//!
//! `planar`: two slides and a turn about the normal, in that order, through two links that weigh nothing. Its coordinates
//! `(x, y, angle)` have no singularity, so this is exact.
//! `floating`, from a root link that is nothing but a name (`world`) to the robot: a free base.
//! A ball joint has no such coordinates: any three angles have a singularity. It is refused.

use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use urdf_rs::JointType;

use super::lump::{axis, losses};
use super::{Joint, JointKind, Link, UrdfError};
use crate::spatial::BodyInertia;

/// What the last joint of a planar one is called after its name.
pub(super) const TURN: &str = "turn";

/// Refuses a file that uses a name which a planar joint's own joints and links have.
pub(super) fn unnamed(file: &urdf_rs::Robot) -> Result<(), UrdfError> {
    for planar in file.joints.iter().filter(|j| j.joint_type == JointType::Planar) {
        let made = |of: &str, name: &str| name.strip_prefix(of).is_some_and(|rest| [".x", ".y", ".turn"].contains(&rest));
        let taken = file.joints.iter().map(|j| &j.name).find(|name| made(&planar.name, name));
        let taken = taken.or_else(|| file.links.iter().map(|l| &l.name).find(|name| made(&planar.child.link, name)));
        if let Some(taken) = taken {
            return Err(UrdfError::joint(
                &planar.name,
                format!("a planar joint makes a part `{taken}`, and the file has another of that name"),
            ));
        }
    }
    Ok(())
}

/// Links and joints of a planar joint but for its last joint, and that one. `origin` is its frame in the moving link above it, which is
/// `host`; the new links are at `next` and after.
pub(super) fn planar(
    source: &urdf_rs::Joint,
    child: &str,
    origin: Isometry3<f64>,
    (host, next): (Option<usize>, usize),
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
    // The plane's own axes: those of the joint's frame where the normal is its z.
    let tilt = UnitQuaternion::rotation_between(&Vector3::z(), &normal)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let (damping, friction) = losses(source)?;
    let damped = |word: &str, kind: JointKind, at: Isometry3<f64>, axis: Unit<Vector3<f64>>| {
        let mut joint = Joint::new(format!("{}.{word}", source.name), kind, at, axis);
        (joint.damping, joint.friction) = (damping, friction);
        joint
    };
    let slide = |word: &str, parent, at, axis| {
        let joint = Some(damped(word, JointKind::Prismatic, at, axis));
        Link { name: format!("{child}.{word}"), parent, joint, inertia: BodyInertia::default(), shapes: Vec::new() }
    };
    let here = Isometry3::identity();
    let links = [slide("x", host, origin, tilt * Vector3::x_axis()), slide("y", Some(next), here, tilt * Vector3::y_axis())];
    Ok((links, damped(TURN, JointKind::Continuous, here, normal)))
}

/// The joint from a root that is nothing but a name to a robot that floats, and the robot's own root.
pub(super) fn freed(file: &urdf_rs::Robot, root: usize, children: &[(usize, usize)]) -> Option<(usize, usize)> {
    let link = &file.links[root];
    let named = link.inertial.mass.value == 0.0 && link.collision.is_empty();
    match children {
        [(joint, child)] if named && file.joints[*joint].joint_type == JointType::Floating => Some((*joint, *child)),
        _ => None,
    }
}
