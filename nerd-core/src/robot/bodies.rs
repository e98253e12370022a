//! The bodies and joints in a robot's file, before fixed joints are lumped. The readers of URDF and of MJCF both
//! produce [`Bodies`].

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

/// One body. The poses and the inertia of a body are in the frame of the joint that carries the body.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name.
    pub name: String,
    /// The file's body frame, in the frame of the joint: an MJCF joint may be anywhere on its body.
    pub frame: Isometry3<f64>,
    /// Inertia, in the frame of the joint that carries the body.
    pub inertia: BodyInertia,
    /// Share of the body's weight that gravity compensation cancels, 0 to 1.
    pub lifted: f64,
    /// Collision solids.
    pub collisions: Vec<Solid>,
    /// Visual solids.
    pub visuals: Vec<Solid>,
}

/// A solid fixed on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Pose in the frame of the joint that carries the body.
    pub pose: Isometry3<f64>,
    /// Primitive, mesh file or convex hull.
    pub form: Form,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// The form of a solid: a primitive, a mesh file or a convex hull.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A primitive shape, such as a box.
    Shape(ShapeKind),
    /// A mesh file, named as in the robot's file. `scale` multiplies the mesh's lengths along the mesh's axes.
    Mesh {
        /// Path of the mesh, as written in the robot's file.
        file: String,
        /// Factors of the mesh's lengths along its x, y and z axes.
        scale: Vector3<f64>,
    },
    /// The convex hull of a list of vertices (m).
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
    /// Six DoFs; allowed only between an empty root body and the single body on it.
    Floating,
}

/// A joint between two bodies. Springs and armature are not here: the system's `[[joint]]` gives them, also for a robot
/// from an MJCF.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyJoint {
    /// Name.
    pub name: String,
    /// Type of motion.
    pub kind: BodyJointKind,
    /// Index of the body that carries the joint.
    pub parent: usize,
    /// Index of the body that the joint carries.
    pub child: usize,
    /// Pose of the joint frame in the frame of the joint that carries the parent body.
    pub origin: Isometry3<f64>,
    /// Axis, in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lower and upper limit (rad or m); `None` without limits.
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
    /// Change of the mimic joint's position (rad or m) per unit of the leading joint's position.
    pub multiplier: f64,
    /// Position of the mimic joint (rad or m) at zero position of the leading joint.
    pub offset: f64,
}
