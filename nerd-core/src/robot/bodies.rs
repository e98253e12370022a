//! The bodies of a robot as its file has them, before fixed joints are lumped. The readers of URDF and of MJCF both produce these.

use nalgebra::{Isometry3, Unit, Vector3};

use super::{FreeRoot, ShapeKind};
use crate::spatial::BodyInertia;

/// The bodies of a robot and the joints between them, a tree with one root. Names are unique. [`super::UrdfRobot::of`] makes the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bodies {
    /// Name of the robot.
    pub name: String,
    /// Bodies, in the order of the file.
    pub bodies: Vec<Body>,
    /// Armature and damping of a free root.
    pub free: FreeRoot,
    /// Joints, in the order of the file; siblings keep it in the robot.
    pub joints: Vec<BodyJoint>,
}

/// One body, in the frame of the joint that it hangs on.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name.
    pub name: String,
    /// The file's frame of the body, in the joint's frame: an MJCF's joint may be anywhere on its body.
    pub frame: Isometry3<f64>,
    /// Inertia.
    pub inertia: BodyInertia,
    /// Share of its weight that is compensated, 0 to 1.
    pub lifted: f64,
    /// Solids that it touches with.
    pub collisions: Vec<Solid>,
    /// Solids that are drawn.
    pub visuals: Vec<Solid>,
}

/// A solid fixed on a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Its pose on the body.
    pub pose: Isometry3<f64>,
    /// Its form.
    pub form: Form,
    /// Index of its contact properties in the file's table, where a file has one.
    pub surface: Option<usize>,
}

/// The form of a solid.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A primitive.
    Shape(ShapeKind),
    /// A mesh file as the robot's file names it, its lengths multiplied along its own axes.
    Mesh {
        /// The file.
        file: String,
        /// Factors.
        scale: Vector3<f64>,
    },
    /// The convex hull of these vertices (m).
    Hull(Vec<Vector3<f64>>),
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyJointKind {
    /// Not at all.
    Fixed,
    /// A hinge with a range.
    Revolute,
    /// A hinge without one.
    Continuous,
    /// A slide.
    Prismatic,
    /// In a plane, across the axis: two slides and a hinge.
    Planar,
    /// Freely; only between a root that has nothing but a name and the one body on it.
    Floating,
}

/// A joint between two bodies.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyJoint {
    /// Name.
    pub name: String,
    /// How it moves.
    pub kind: BodyJointKind,
    /// Index of the body that carries it.
    pub parent: usize,
    /// Index of the body that hangs on it.
    pub child: usize,
    /// Its frame in the frame of the parent's joint.
    pub origin: Isometry3<f64>,
    /// Its axis, in its own frame.
    pub axis: Unit<Vector3<f64>>,
    /// Ends of its range (rad or m).
    pub range: Option<[f64; 2]>,
    /// Largest effort (N m or N); infinite where none is given.
    pub effort: f64,
    /// Largest velocity (rad/s or m/s); infinite where none is given.
    pub velocity: f64,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Dry friction (N m or N).
    pub friction: f64,
    /// The joint that it follows.
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

/// A joint that follows another: `position = multiplier q + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyMimic {
    /// Name of the joint that leads.
    pub joint: String,
    /// rad or m per unit of its position.
    pub multiplier: f64,
    /// Position (rad or m) where the leading joint's is zero.
    pub offset: f64,
}
