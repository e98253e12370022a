//! Adds one body or joint of a file to the robot. A body's inertia and shapes are lumped into the moving link that
//! carries the body. A joint gets its properties from the file.

use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};

use super::{
    Body, BodyJoint, BodyJointKind, Form, Hull, Joint, JointKind, Limit, Link, MeshFile, Robot, Shape, UrdfError,
    UrdfRobot,
};
use crate::spatial::{BodyInertia, PointMass};

/// Bound on mass (kg), centre of mass (m) and inertia (kg m^2) of a link, so that products of a few such numbers stay
/// finite.
const MAX_INERTIAL: f64 = 1e60;

/// Welds a body of the file to moving link `host`, at `pose` in the link frame.
pub(super) fn lump(source: &Body, pose: &Isometry3<f64>, host: usize, read: &mut UrdfRobot) -> Result<(), UrdfError> {
    let wrong = |reason: String| UrdfError::link(&source.name, reason);
    let BodyInertia { mass, com, inertia } = source.inertia;
    if !mass.is_finite() || mass < 0.0 || inertia.iter().any(|x| !x.is_finite()) {
        return Err(wrong(format!("mass {mass} kg or inertia is negative or not finite")));
    }
    if let Some(least) = indefinite(&inertia) {
        // The lumped inertia may still be valid; `sound` checks it at the end.
        read.notes.push(format!(
            "link `{}`: inertia is not positive semi-definite (smallest eigenvalue {least:.3e} kg m^2)",
            source.name
        ));
    }
    let place = pose * Translation3::from(com);
    let body = BodyInertia { com: Vector3::zeros(), ..source.inertia };
    let target = &mut read.robot.links[host];
    target.inertia =
        target.inertia.welded(&body.transformed(&place.rotation.to_rotation_matrix(), &place.translation.vector));
    target.lifted = target.lifted.with(&PointMass { mass: source.lifted * mass, at: place.translation.vector });
    let sum = &target.inertia;
    if !sum.com.iter().chain(sum.inertia.iter()).chain([&sum.mass]).all(|x| x.abs() < MAX_INERTIAL) {
        return Err(wrong("mass, inertia or place is too large to compute with".into()));
    }
    shapes(source, pose, Some(host), read);
    Ok(())
}

/// Adds the collision solids of a body, at `pose`, to moving link `host`; `None` is the fixed base.
pub(super) fn shapes(source: &Body, pose: &Isometry3<f64>, host: Option<usize>, read: &mut UrdfRobot) {
    let mut still = |mesh: &str| {
        read.notes.push(format!("link `{}`: {mesh} is on the fixed base; nothing touches it", source.name))
    };
    for solid in &source.collisions {
        let pose = pose * solid.pose;
        let surface = solid.surface;
        match (&solid.form, host) {
            (Form::Shape(kind), _) => {
                let shapes = host.map_or(&mut read.base, |host| &mut read.robot.links[host].shapes);
                shapes.push(Shape { pose, kind: *kind, surface });
            }
            (Form::Mesh { file, .. }, None) => still(&format!("mesh {file}")),
            (Form::Hull(_), None) => still("a mesh"),
            (Form::Mesh { file, scale }, Some(link)) => {
                read.meshes.push(MeshFile {
                    link,
                    of: source.name.clone(),
                    pose,
                    file: file.clone(),
                    scale: *scale,
                    surface,
                });
            }
            (Form::Hull(vertices), Some(link)) => {
                let vertices = vertices.iter().map(|v| pose.transform_point(&(*v).into()).coords).collect();
                read.hulls.push(Hull { link, vertices, surface });
            }
        }
    }
}

/// The smallest eigenvalue of an inertia (kg m^2), if it is negative by more than rounding.
fn indefinite(inertia: &Matrix3<f64>) -> Option<f64> {
    // The largest entry is scaled to 1 against overflow. An inertia below 1e-15 kg m^2 is taken for rounding error of
    // the program that wrote the file.
    let scale = inertia.amax();
    let least = if scale > 1e-15 { (inertia / scale).symmetric_eigenvalues().min() } else { 0.0 };
    (least < -1e-9).then_some(least * scale)
}

/// Refuses moving links with a lumped inertia that is not positive semi-definite. Notes links that break the triangle
/// inequality: the largest principal moment exceeds the sum of the other two.
pub(super) fn sound(robot: &Robot, notes: &mut Vec<String>) -> Result<(), UrdfError> {
    let odd = |link: &&Link| {
        let moments = link.inertia.inertia.symmetric_eigenvalues();
        2.0 * moments.max() > (1.0 + 1e-3) * moments.sum()
    };
    let odd: Vec<&str> = robot.links.iter().filter(odd).map(|link| link.name.as_str()).collect();
    if !odd.is_empty() {
        notes.push(format!(
            "no body has the inertia of {}: one principal moment is larger than the other two together",
            odd.join(", ")
        ));
    }
    let bad = |link: &Link| indefinite(&link.inertia.inertia).map(|least| (link.name.clone(), least));
    match robot.links.iter().find_map(bad) {
        Some((name, least)) => Err(UrdfError::link(
            &name,
            format!("inertia is not positive semi-definite (smallest eigenvalue {least:.3e} kg m^2)"),
        )),
        None => Ok(()),
    }
}

/// Makes a one-DoF joint from a joint of the file; `origin` is the pose of its frame in the parent link's frame.
pub(super) fn joint(source: &BodyJoint, origin: Isometry3<f64>) -> Result<Joint, UrdfError> {
    let kind = match source.kind {
        BodyJointKind::Revolute => JointKind::Revolute,
        BodyJointKind::Continuous => JointKind::Continuous,
        BodyJointKind::Prismatic => JointKind::Prismatic,
        BodyJointKind::Floating | BodyJointKind::Fixed | BodyJointKind::Planar => {
            let read =
                "a floating joint is read only between a root without mass or shape and the one link that hangs on it";
            return Err(UrdfError::joint(&source.name, read));
        }
    };
    let mut joint = Joint::new(source.name.clone(), kind, origin, source.axis);
    (joint.damping, joint.friction) = (source.damping, source.friction);
    (joint.effort, joint.velocity) = (source.effort, source.velocity);
    joint.limit = source.range.map(|[lower, upper]| Limit { lower, upper, stiffness: 0.0, damping: 0.0 });
    Ok(joint)
}
