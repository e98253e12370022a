//! One link and one joint of a URDF: inertia and shapes lumped to their moving link, and joints with the properties that the dynamics use.

use nalgebra::{Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType};

use super::{Joint, JointKind, Limit, Link, MeshFile, Robot, Shape, ShapeKind, UrdfError, UrdfRobot};
use crate::spatial::BodyInertia;

/// Products of a few numbers below this are still finite; no robot comes near it.
const LARGEST: f64 = 1e60;
/// Farthest place or angle of a pose (m, rad), end of a limit, and largest damping or dry friction.
const FAR: f64 = 1e9;

/// Welds a link of the file, at `pose` in moving link `host`, to it.
pub(super) fn lump(source: &urdf_rs::Link, pose: &Isometry3<f64>, host: usize, read: &mut UrdfRobot) -> Result<(), UrdfError> {
    let wrong = |reason: String| UrdfError::link(&source.name, reason);
    let origin = isometry(&source.inertial.origin).ok_or_else(|| wrong("inertial origin is not finite, or too far".into()))?;
    let i = &source.inertial.inertia;
    let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    let mass = source.inertial.mass.value;
    if !mass.is_finite() || mass < 0.0 || inertia.iter().any(|x| !x.is_finite()) {
        return Err(wrong(format!("mass {mass} kg or inertia is negative or not finite")));
    }
    if let Some(least) = indefinite(&inertia) {
        // Together with what it is fixed on it may be one all the same, which is looked at when all is there.
        read.notes.push(format!("link `{}`: inertia is not positive semi-definite (smallest eigenvalue {least:.3e} kg m^2)", source.name));
    }
    let place = pose * origin;
    let body = BodyInertia { mass, com: Vector3::zeros(), inertia };
    let target = &mut read.robot.links[host];
    target.inertia = target.inertia.welded(&body.transformed(&place.rotation.to_rotation_matrix(), &place.translation.vector));
    let sum = &target.inertia;
    if !sum.com.iter().chain(sum.inertia.iter()).chain([&sum.mass]).all(|x| x.abs() < LARGEST) {
        return Err(wrong("mass, inertia or place is too large to compute with".into()));
    }
    shapes(source, pose, Some(host), read)
}

/// Hangs the shapes of a link of the file, at `pose` in moving link `host`, on it; on the base, where there is none.
pub(super) fn shapes(source: &urdf_rs::Link, pose: &Isometry3<f64>, host: Option<usize>, read: &mut UrdfRobot) -> Result<(), UrdfError> {
    let wrong = |reason: String| UrdfError::link(&source.name, reason);
    for collision in &source.collision {
        let pose = pose * isometry(&collision.origin).ok_or_else(|| wrong("collision origin is not finite, or too far".into()))?;
        match shape(&collision.geometry) {
            // Engines assert on -0.
            Some(kind) if sizes(&kind).iter().all(|x| x.is_sign_positive() && *x <= FAR) => {
                let shapes = host.map_or(&mut read.base, |host| &mut read.robot.links[host].shapes);
                shapes.push(Shape { pose, kind });
            }
            Some(_) => return Err(wrong("a collision shape has a negative size, or one that is not finite or absurd".into())),
            None => match (mesh(&collision.geometry, host.unwrap_or_default(), &source.name, pose), host) {
                (Some(mesh), None) => {
                    read.notes.push(format!("link `{}`: mesh {} is on the fixed base; nothing touches it", mesh.of, mesh.file))
                }
                (mesh, _) => read.meshes.extend(mesh),
            },
        }
    }
    Ok(())
}

/// The smallest eigenvalue of an inertia that is negative by more than rounding.
fn indefinite(inertia: &Matrix3<f64>) -> Option<f64> {
    // Scaled to 1, so that no finite numbers overflow; what is no more than rounding of a file's maker is no inertia.
    let scale = inertia.amax();
    let least = if scale > 1e-15 { (inertia / scale).symmetric_eigenvalues().min() } else { 0.0 };
    (least < -1e-9).then_some(least * scale)
}

/// Refuses moving links whose inertia, all fixed ones included, is not positive; notes those whose largest principal moment is more than the
/// other two together, which no body has.
pub(super) fn sound(robot: &Robot, notes: &mut Vec<String>) -> Result<(), UrdfError> {
    let odd = |link: &&Link| {
        let moments = link.inertia.inertia.symmetric_eigenvalues();
        2.0 * moments.max() > (1.0 + 1e-3) * moments.sum()
    };
    let odd: Vec<&str> = robot.links.iter().filter(odd).map(|link| link.name.as_str()).collect();
    if !odd.is_empty() {
        notes.push(format!("no body has the inertia of {}: one principal moment is larger than the other two together", odd.join(", ")));
    }
    let bad = |link: &Link| indefinite(&link.inertia.inertia).map(|least| (link.name.clone(), least));
    match robot.links.iter().find_map(bad) {
        Some((name, least)) => {
            Err(UrdfError::link(&name, format!("inertia is not positive semi-definite (smallest eigenvalue {least:.3e} kg m^2)")))
        }
        None => Ok(()),
    }
}

/// A moving joint of the file; `origin` is its frame in the moving link above it.
pub(super) fn joint(source: &urdf_rs::Joint, origin: Isometry3<f64>, notes: &mut Vec<String>) -> Result<Joint, UrdfError> {
    let wrong = |reason: &str| UrdfError::joint(&source.name, reason);
    let kind = match source.joint_type {
        JointType::Revolute => JointKind::Revolute,
        JointType::Continuous => JointKind::Continuous,
        JointType::Prismatic => JointKind::Prismatic,
        JointType::Floating => {
            return Err(wrong("a floating joint is read only between a root without mass or shape and the one link that hangs on it"));
        }
        ref other => return Err(wrong(&format!("type {other:?} is not supported; write it as revolute, continuous or prismatic joints"))),
    };
    let mut joint = Joint::new(source.name.clone(), kind, origin, axis(source)?);
    (joint.damping, joint.friction) = losses(source)?;
    let (limit, given) = (&source.limit, |x: f64| if x.is_finite() && x > 0.0 { x } else { f64::INFINITY });
    (joint.effort, joint.velocity) = (given(limit.effort), given(limit.velocity));
    if kind != JointKind::Continuous {
        joint.limit = match (limit.lower, limit.upper) {
            // What a file means that leaves it out, since a joint that cannot move is a fixed one.
            (0.0, 0.0) if limit.effort == 0.0 && limit.velocity == 0.0 => {
                notes.push(format!("joint `{}`: <limit> is missing or all zero; it moves without end", source.name));
                None
            }
            (lower, upper) if lower > upper => return Err(wrong(&format!("lower limit {lower} is above upper limit {upper}"))),
            // What URDF 1.2 means by leaving both out, and what others write for it.
            (lower, upper) if lower <= -FAR && upper >= FAR => {
                notes.push(format!("joint `{}`: <limit> has no bounds; it moves without end", source.name));
                None
            }
            (lower, upper) if lower >= -FAR && upper <= FAR => Some(Limit { lower, upper, stiffness: 0.0, damping: 0.0 }),
            _ => return Err(wrong("a limit is not finite, or beyond 1e9; give both ends or neither")),
        };
    }
    Ok(joint)
}

pub(super) fn axis(source: &urdf_rs::Joint) -> Result<Unit<Vector3<f64>>, UrdfError> {
    let axis = Vector3::from(*source.axis.xyz);
    let usable = (1e-9..1e9).contains(&axis.norm());
    Unit::try_new(axis, 0.0).filter(|_| usable).ok_or_else(|| UrdfError::joint(&source.name, "axis has no direction or is not finite"))
}

pub(super) fn losses(source: &urdf_rs::Joint) -> Result<(f64, f64), UrdfError> {
    let Some(dynamics) = &source.dynamics else { return Ok((0.0, 0.0)) };
    for (what, value) in [("damping", dynamics.damping), ("friction", dynamics.friction)] {
        if !(0.0..=FAR).contains(&value) {
            return Err(UrdfError::joint(&source.name, format!("{what} is {value:e}; a number from 0 to {FAR:e} is needed")));
        }
    }
    Ok((dynamics.damping, dynamics.friction))
}

/// `None` for a mesh, which is no primitive.
fn shape(geometry: &Geometry) -> Option<ShapeKind> {
    match geometry {
        Geometry::Box { size } => Some(ShapeKind::Box { half: Vector3::from(**size) * 0.5 }),
        Geometry::Cylinder { radius, length } => Some(ShapeKind::Cylinder { radius: *radius, half_length: 0.5 * length }),
        Geometry::Capsule { radius, length } => Some(ShapeKind::Capsule { radius: *radius, half_length: 0.5 * length }),
        Geometry::Sphere { radius } => Some(ShapeKind::Sphere { radius: *radius }),
        Geometry::Mesh { .. } => None,
    }
}

fn mesh(geometry: &Geometry, link: usize, of: &str, pose: Isometry3<f64>) -> Option<MeshFile> {
    let Geometry::Mesh { filename, scale } = geometry else { return None };
    Some(MeshFile { link, of: of.into(), pose, file: filename.clone(), scale: scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(*s)) })
}

fn sizes(kind: &ShapeKind) -> [f64; 3] {
    match *kind {
        ShapeKind::Sphere { radius } => [radius, radius, radius],
        ShapeKind::Box { half } => half.into(),
        ShapeKind::Cylinder { radius, half_length } | ShapeKind::Capsule { radius, half_length } => [radius, half_length, radius],
    }
}

/// A URDF pose (roll, pitch, yaw about fixed axes), if finite and not absurdly far.
pub(super) fn isometry(pose: &urdf_rs::Pose) -> Option<Isometry3<f64>> {
    let ([x, y, z], [roll, pitch, yaw]) = (*pose.xyz, *pose.rpy);
    let finite = [x, y, z, roll, pitch, yaw].iter().all(|v| v.abs() <= FAR);
    finite.then(|| Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}
