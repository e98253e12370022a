//! Reads the bodies of a URDF with urdf-rs. Unsupported elements are refused by link or joint.

use std::collections::{HashMap, HashSet};

use nalgebra::{Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType};

use super::xml::prepared;
use super::{Bodies, Body, BodyJoint, BodyJointKind, BodyMimic, Form, FreeRoot, ShapeKind, Solid, UrdfError};
use crate::spatial::BodyInertia;

/// Largest accepted number: pose (m, rad), joint limit (rad or m), size (m), damping and dry friction (SI units).
const MAX_COORDINATE: f64 = 1e9;

impl Bodies {
    /// Reads the text of a URDF. Also returns the assumptions made where the text is silent, one line each. A visual
    /// that cannot be read is left out.
    ///
    /// # Errors
    /// If the text is refused; the error names the link or joint and the reason. [`super::UrdfRobot::of`] checks
    /// whether the joints form a tree.
    pub fn from_urdf(xml: &str) -> Result<(Self, Vec<String>), UrdfError> {
        // Skip a byte-order mark.
        let (plain, looks) = prepared(xml.trim_start_matches('\u{feff}'))?;
        if !plain.contains('<') {
            return Err(UrdfError::text("it has no element; the text of a URDF is needed, not its path"));
        }
        // urdf-rs may panic on malformed text; the panic is caught and becomes an error.
        let parsed = std::panic::catch_unwind(|| urdf_rs::read_from_string(&plain));
        let file =
            parsed.unwrap_or_else(|_| Err("malformed text".into())).map_err(|e| UrdfError::text(&e.to_string()))?;
        let mut index = HashMap::new();
        let mut names = HashSet::new();
        let mut notes = Vec::new();
        for (i, link) in file.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                return Err(UrdfError::link(&link.name, "name used twice"));
            }
        }
        if let Some(twice) = file.joints.iter().find(|joint| !names.insert(joint.name.as_str())) {
            return Err(UrdfError::joint(&twice.name, "name used twice"));
        }
        let looks = looks.into_iter().chain(std::iter::repeat(Vec::new()));
        let bodies =
            file.links.iter().zip(looks).map(|(link, visuals)| body(link, visuals)).collect::<Result<_, _>>()?;
        let ends = |joint: &urdf_rs::Joint| {
            let find = |name: &str| index.get(name).copied();
            let find =
                |name: &str| find(name).ok_or_else(|| UrdfError::joint(&joint.name, format!("unknown link `{name}`")));
            Ok([find(&joint.parent.link)?, find(&joint.child.link)?])
        };
        let mut joints = Vec::new();
        for source in &file.joints {
            let mut joint = joint(source, ends(source)?, &mut notes)?;
            if let Some(away) = joint.mimic.take_if(|mimic| !names.contains(mimic.joint.as_str())) {
                notes.push(format!(
                    "joint `{}`: <mimic> of `{}`, which is not there; it moves by itself",
                    joint.name, away.joint
                ));
            }
            joints.push(joint);
        }
        let robot = Self { name: file.name.clone(), free: FreeRoot::default(), bodies, joints };
        Ok((robot, notes))
    }
}

fn body(source: &urdf_rs::Link, visuals: Vec<Solid>) -> Result<Body, UrdfError> {
    let wrong = |reason: &str| UrdfError::link(&source.name, reason);
    let origin = isometry(&source.inertial.origin).ok_or_else(|| wrong("inertial origin is not finite, or too far"))?;
    let i = &source.inertial.inertia;
    let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    let inertia = BodyInertia { mass: source.inertial.mass.value, com: Vector3::zeros(), inertia };
    let inertia = inertia.transformed(&origin.rotation.to_rotation_matrix(), &origin.translation.vector);
    let solid = |collision: &urdf_rs::Collision| {
        let pose = isometry(&collision.origin).ok_or_else(|| wrong("collision origin is not finite, or too far"))?;
        let form = form(&collision.geometry);
        match &form {
            // A size of -0.0 is refused too: physics engines assert on it.
            Form::Shape(kind) if !sizes(kind).iter().all(|x| x.is_sign_positive() && *x <= MAX_COORDINATE) => {
                Err(wrong("a collision shape has a negative size, or one that is not finite or absurd"))
            }
            _ => Ok(Solid { pose, form, surface: None }),
        }
    };
    let collisions = source.collision.iter().map(solid).collect::<Result<_, _>>()?;
    Ok(Body { name: source.name.clone(), frame: Isometry3::identity(), inertia, lifted: 0.0, collisions, visuals })
}

fn joint(
    source: &urdf_rs::Joint,
    [parent, child]: [usize; 2],
    notes: &mut Vec<String>,
) -> Result<BodyJoint, UrdfError> {
    let wrong = |reason: &str| UrdfError::joint(&source.name, reason);
    let kind = kind(source)?;
    let origin = isometry(&source.origin);
    let mut joint =
        BodyJoint { kind, ..BodyJoint::fixed(source.name.clone(), [parent, child], origin.unwrap_or_default()) };
    if kind == BodyJointKind::Floating {
        let said = source.origin.xyz.iter().chain(&*source.origin.rpy).any(|x| *x != 0.0) || source.dynamics.is_some();
        if said || source.mimic.is_some() {
            notes.push(format!(
                "joint `{}`: its <origin>, <dynamics> and <mimic> are passed over, since it makes the base free",
                source.name
            ));
        }
        return Ok(BodyJoint { origin: Isometry3::identity(), ..joint });
    }
    if origin.is_none() {
        return Err(wrong("origin is not finite, or farther than 1e9 m or rad"));
    }
    if kind == BodyJointKind::Fixed {
        return Ok(joint);
    }
    joint.axis = axis(source)?;
    (joint.damping, joint.friction) = losses(source)?;
    let limit = &source.limit;
    if kind == BodyJointKind::Planar {
        if source.mimic.is_some() {
            return Err(wrong("a planar joint has three coordinates, and none of them can follow by <mimic>"));
        }
        if [limit.lower, limit.upper, limit.effort, limit.velocity].iter().any(|x| *x != 0.0) {
            notes.push(format!(
                "joint `{}`: <limit> is passed over, since a planar joint has three coordinates",
                source.name
            ));
        }
        return Ok(joint);
    }
    [joint.effort, joint.velocity] =
        [limit.effort, limit.velocity].map(|x| if x.is_finite() && x > 0.0 { x } else { f64::INFINITY });
    let mimic = |m: &urdf_rs::Mimic| BodyMimic {
        joint: m.joint.clone(),
        multiplier: m.multiplier.unwrap_or(1.0),
        offset: m.offset.unwrap_or(0.0),
    };
    joint.mimic = source.mimic.as_ref().map(mimic);
    if kind != BodyJointKind::Continuous {
        joint.range = range(source, notes)?;
    }
    Ok(joint)
}

fn kind(source: &urdf_rs::Joint) -> Result<BodyJointKind, UrdfError> {
    Ok(match source.joint_type {
        JointType::Fixed => BodyJointKind::Fixed,
        JointType::Revolute => BodyJointKind::Revolute,
        JointType::Continuous => BodyJointKind::Continuous,
        JointType::Prismatic => BodyJointKind::Prismatic,
        JointType::Planar => BodyJointKind::Planar,
        JointType::Floating => BodyJointKind::Floating,
        ref other => {
            let reason =
                format!("type {other:?} is not supported; write it as revolute, continuous or prismatic joints");
            return Err(UrdfError::joint(&source.name, reason));
        }
    })
}

/// Limits of a hinge or a slide.
fn range(source: &urdf_rs::Joint, notes: &mut Vec<String>) -> Result<Option<[f64; 2]>, UrdfError> {
    let limit = &source.limit;
    let wrong = |reason: &str| UrdfError::joint(&source.name, reason);
    match (limit.lower, limit.upper) {
        // urdf-rs gives a missing limit as zeros. So all zeros count as no limit; a joint of zero range would be fixed.
        (0.0, 0.0) if limit.effort == 0.0 && limit.velocity == 0.0 => {
            notes.push(format!("joint `{}`: <limit> is missing or all zero, and limits nothing", source.name));
            Ok(None)
        }
        (lower, upper) if lower > upper => Err(wrong(&format!("lower limit {lower} is above upper limit {upper}"))),
        // No limit is meant: URDF 1.2 leaves out both ends, and other tools write huge numbers.
        (lower, upper) if lower <= -MAX_COORDINATE && upper >= MAX_COORDINATE => {
            notes.push(format!("joint `{}`: <limit> has no bounds, and limits nothing", source.name));
            Ok(None)
        }
        (lower, upper) if lower >= -MAX_COORDINATE && upper <= MAX_COORDINATE => Ok(Some([lower, upper])),
        _ => Err(wrong("a limit is not finite, or beyond 1e9; give both ends or neither")),
    }
}

fn axis(source: &urdf_rs::Joint) -> Result<Unit<Vector3<f64>>, UrdfError> {
    let axis = Vector3::from(*source.axis.xyz);
    let usable = (1e-9..1e9).contains(&axis.norm());
    Unit::try_new(axis, 0.0)
        .filter(|_| usable)
        .ok_or_else(|| UrdfError::joint(&source.name, "axis has no direction or is not finite"))
}

fn losses(source: &urdf_rs::Joint) -> Result<(f64, f64), UrdfError> {
    let Some(dynamics) = &source.dynamics else { return Ok((0.0, 0.0)) };
    for (what, value) in [("damping", dynamics.damping), ("friction", dynamics.friction)] {
        if !(0.0..=MAX_COORDINATE).contains(&value) {
            return Err(UrdfError::joint(
                &source.name,
                format!("{what} is {value:e}; a number from 0 to {MAX_COORDINATE:e} is needed"),
            ));
        }
    }
    Ok((dynamics.damping, dynamics.friction))
}

fn form(geometry: &Geometry) -> Form {
    Form::Shape(match geometry {
        Geometry::Box { size } => ShapeKind::Box { half: Vector3::from(**size) * 0.5 },
        Geometry::Cylinder { radius, length } => ShapeKind::Cylinder { radius: *radius, half_length: 0.5 * length },
        Geometry::Capsule { radius, length } => ShapeKind::Capsule { radius: *radius, half_length: 0.5 * length },
        Geometry::Sphere { radius } => ShapeKind::Sphere { radius: *radius },
        Geometry::Mesh { filename, scale } => {
            let scale = scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(*s));
            return Form::Mesh { file: filename.clone(), scale };
        }
    })
}

fn sizes(kind: &ShapeKind) -> [f64; 3] {
    match *kind {
        ShapeKind::Sphere { radius } => [radius, radius, radius],
        ShapeKind::Box { half } => half.into(),
        ShapeKind::Cylinder { radius, half_length } | ShapeKind::Capsule { radius, half_length } => {
            [radius, half_length, radius]
        }
    }
}

/// A URDF pose (roll, pitch, yaw about fixed axes), if finite and within `MAX_COORDINATE`.
fn isometry(pose: &urdf_rs::Pose) -> Option<Isometry3<f64>> {
    let [x, y, z] = *pose.xyz;
    let [roll, pitch, yaw] = *pose.rpy;
    let finite = [x, y, z, roll, pitch, yaw].iter().all(|v| v.abs() <= MAX_COORDINATE);
    finite
        .then(|| Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}
