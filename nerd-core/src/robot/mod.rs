//! The robot: a tree of links joined by one-DoF joints, on a fixed or a floating base.

mod bodies;
mod joint;
mod loaded;
mod lump;
mod mimic;
mod model;
mod names;
mod planar;
mod scale;
mod shape;
mod tree;
mod urdf;
mod visual;
mod words;
mod xml;

pub use bodies::{Bodies, Body, BodyJoint, BodyJointKind, BodyMimic, Form, Solid};
pub use joint::{Joint, JointKind, Limit, Mimic};
pub use loaded::{Hull, MeshFile, UrdfError, UrdfRobot};
pub use model::{Base, FixedFrame, FreeRoot, Link, Robot};
pub use names::{JointIndex, UnknownName};
pub use shape::{Shape, ShapeKind};
