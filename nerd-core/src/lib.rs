#![doc = include_str!("../README.md")]

pub mod contact;
pub mod dynamics;
pub mod frames;
pub mod robot;
pub mod spatial;
pub mod state;

pub use nalgebra;

/// What most programs need.
pub mod prelude {
    pub use crate::contact::{ContactEvent, ContactPoint};
    pub use crate::dynamics::{Data, aba, bias, crba, kinematics, rnea};
    pub use crate::frames::RootFrame;
    pub use crate::robot::{Base, Joint, JointKind, Limit, Link, Robot, Shape, UrdfError};
    pub use crate::spatial::{BodyInertia, Motion, SpatialInertia, Wrench};
    pub use crate::state::wrap;
}
