//! Robot models, spatial algebra, articulated-body dynamics, robot-centric frames and contact quantities.
//!
//! Units are SI; frames are right-handed; numbers are f64. Quaternions in a state are `(x, y, z, w)`, twists and
//! wrenches hold the angular part first. This crate knows no engine and no network.

pub mod contact;
pub mod dynamics;
pub mod frames;
pub mod robot;
pub mod spatial;
pub mod state;

/// What most programs need.
pub mod prelude {
    pub use crate::contact::{ContactEvent, ContactPoint};
    pub use crate::dynamics::{Data, aba, bias, crba, kinematics, rnea};
    pub use crate::frames::RootFrame;
    pub use crate::robot::{Base, Joint, JointKind, Limit, Link, Robot, Shape, UrdfError};
    pub use crate::spatial::{BodyInertia, Motion, SpatialInertia, Wrench};
    pub use crate::state::wrap;
}
