//! The robot: a tree of links joined by one-DoF joints, on a fixed or a floating base.

mod joint;
mod lump;
mod mimic;
mod model;
mod scale;
mod several;
mod shape;
mod urdf;
mod words;
mod xml;

pub use joint::{Joint, JointKind, Limit, Mimic};
pub use model::{Base, FixedFrame, Link, MeshFile, Robot};
pub use shape::{Shape, ShapeKind};
pub use urdf::UrdfError;
