//! The robot: a tree of links joined by one-DoF joints, on a fixed or a floating base.

mod joint;
mod loaded;
mod lump;
mod mimic;
mod model;
mod names;
mod planar;
mod scale;
mod shape;
mod urdf;
mod words;
mod xml;

pub use joint::{Joint, JointKind, Limit, Mimic};
pub use loaded::{Hull, MeshFile, UrdfError, UrdfRobot};
pub use model::{Base, FixedFrame, Link, Robot};
pub use names::{JointIndex, UnknownName};
pub use shape::{Shape, ShapeKind};
