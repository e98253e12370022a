#![doc = include_str!("../README.md")]

pub mod contact;
pub mod dynamics;
pub mod frames;
pub mod robot;
pub mod spatial;
pub mod state;
pub mod tangent;
pub mod velocity;

pub use nalgebra;

/// Names that most programs need.
pub mod prelude {
    pub use crate::contact::{ContactEvent, ContactPoint, Locus};
    pub use crate::dynamics::{Axes, Data, Derivatives, NoInertia, Totals, kinematics, point_position, totals};
    pub use crate::frames::RootFrame;
    pub use crate::robot::{
        Base, FixedFrame, Joint, JointIndex, JointKind, Limit, Link, Robot, Shape, UnknownName, UrdfError, UrdfRobot,
    };
    pub use crate::spatial::{BodyInertia, Motion, PointMass, SpatialInertia, Wrench, rotation_from};
    pub use crate::state::{quaternion, raw_quaternion, vector, wrap, write_quaternion};
    pub use crate::velocity::{LocalVelocity, SpatialTwist};
    pub use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
}
