//! Forward kinematics and the three classical algorithms: RNEA (inverse dynamics), CRBA (mass matrix), ABA (forward
//! dynamics), after Featherstone 2008, chapters 5 to 7; Jacobians and analytic derivatives.
//!
//! **One frame for all links.** Its axes are the world's, and its origin is at the root: the floating base's position,
//! or the fixed base. The frame is taken as inertial. Every spatial vector of the robot is expressed in this frame. So
//! no transform between links is needed, and numbers stay small however far the robot is from the world's origin.
//!
//! The methods of [`Data`] are the interface. The stages behind these methods take velocities as slices in the local
//! form ([`crate::velocity`]) and allocate nothing. The docs of a stage name the stages that must run before it. For a
//! floating root the stages take and return spatial accelerations, `(w_dot, p_ddot - w x p_dot)`.

mod adjoint;
mod crba;
mod data;
mod derivatives;
mod jacobian;
mod kinematics;
mod ltl;
mod queries;
mod rnea;
mod sweeps;
mod totals;
mod tree;

pub use data::Data;
pub use derivatives::Derivatives;
pub use jacobian::Axes;
pub use queries::NoInertia;
pub use totals::{Totals, totals};

#[doc(hidden)]
pub use self::{
    adjoint::{Adjoint, motions, motions_back, onto},
    crba::crba,
    kinematics::{inertias, kinematics, kinematics_about, link_pose, point_position},
    ltl::Factor,
    rnea::{bias, rnea, velocities},
    sweeps::aba,
    tree::{Inverse, TreeFactor},
};
#[doc(hidden)]
pub use crate::velocity::{drift, move_twist, root_position, to_local, to_world};
