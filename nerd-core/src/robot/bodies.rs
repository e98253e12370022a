//! The bodies and joints in a robot's file, before fixed joints are lumped. The readers of URDF and of MJCF both
//! produce these.

use nalgebra::{Isometry3, Unit, Vector3};

use super::{FreeRoot, ShapeKind};
use crate::spatial::BodyInertia;

/// The bodies of a robot and the joints between them, a tree with one root. Names are unique. [`super::UrdfRobot::of`]
/// makes the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bodies {
    /// Name of the robot.
    pub name: String,
    /// Bodies, in the order of the file.
    pub bodies: Vec<Body>,
    /// Armature and damping of a free root.
    pub free: FreeRoot,
    /// Joints, in the order of the file. Sibling joints keep this order in the robot.
    pub joints: Vec<BodyJoint>,
}

/// One body. Poses are in the frame of the joint that carries it.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name.
    pub name: String,
    /// Frame of the body in the file, relative to the joint's frame: an MJCF joint may be anywhere on its body.
    pub frame: Isometry3<f64>,
    /// Inertia.
    pub inertia: BodyInertia,
    /// Share of the weight that is compensated, 0 to 1.
    pub lifted: f64,
    /// Collision solids.
    pub collisions: Vec<Solid>,
    /// Visual solids.
    pub visuals: Vec<Solid>,
}

/// A solid fixed on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Pose on the body.
    pub pose: Isometry3<f64>,
    /// Form.
    pub form: Form,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// The form of a solid.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A primitive.
    Shape(ShapeKind),
    /// A mesh file, named as in the robot's file. `scale` multiplies its lengths along its axes.
    Mesh {
        /// The file.
        file: String,
        /// Factors.
        scale: Vector3<f64>,
    },
    /// The convex hull of these vertices (m).
    Hull(Vec<Vector3<f64>>),
}

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyJointKind {
    /// No motion.
    Fixed,
    /// A hinge with limits.
    Revolute,
    /// A hinge without limits.
    Continuous,
    /// A slide.
    Prismatic,
    /// Motion in the plane perpendicular to the axis: two slides and a hinge.
    Planar,
    /// Six DoF; only between an empty root body and the single body on it.
    Floating,
}

/// A joint between two bodies. Springs and armature are not here: a system's `[[joint]]` has them, also from an MJCF.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyJoint {
    /// Name.
    pub name: String,
    /// Type of motion.
    pub kind: BodyJointKind,
    /// Index of the body that carries it.
    pub parent: usize,
    /// Index of the body that it carries.
    pub child: usize,
    /// Joint frame in the frame of the parent's joint.
    pub origin: Isometry3<f64>,
    /// Axis, in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lower and upper limit (rad or m).
    pub range: Option<[f64; 2]>,
    /// Largest effort (N m or N); infinite if the file gives none.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite if the file gives none.
    pub velocity: f64,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N).
    pub friction: f64,
    /// For a mimic joint, the joint that it follows.
    pub mimic: Option<BodyMimic>,
}

impl BodyJoint {
    /// A joint that fixes body `child` to `parent`, with no limits, damping or friction.
    pub fn fixed(name: String, [parent, child]: [usize; 2], origin: Isometry3<f64>) -> Self {
        Self {
            name,
            kind: BodyJointKind::Fixed,
            parent,
            child,
            origin,
            axis: Vector3::x_axis(),
            range: None,
            effort: f64::INFINITY,
            velocity: f64::INFINITY,
            damping: 0.0,
            friction: 0.0,
            mimic: None,
        }
    }
}

/// A mimic joint's law: `position = multiplier q + offset`, with q the position of another joint.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyMimic {
    /// Name of the leading joint.
    pub joint: String,
    /// rad or m per unit of the leading joint's position.
    pub multiplier: f64,
    /// Position (rad or m) at zero position of the leading joint.
    pub offset: f64,
}
