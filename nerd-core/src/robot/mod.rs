//! The robot: a tree of links joined by one-DoF joints, on a fixed or a floating base.

mod lump;
mod model;
mod urdf;
mod xml;

pub use model::{Base, Joint, JointKind, Limit, Link, PlacedBox, Robot, Shape, ShapeKind};
pub use urdf::UrdfError;
