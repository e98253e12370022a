//! Forward kinematics and the three classical algorithms: RNEA (inverse dynamics), CRBA (mass matrix), ABA
//! (forward dynamics), after Featherstone 2008, chapters 5 to 7; Jacobians and analytic derivatives.
//!
//! **One frame for all.** World axes, origin at the root (the floating base's position, or the fixed base). It is
//! an inertial frame that happens to stand where the root is now, so every spatial vector of the robot lives in it,
//! no transform between links is needed, and numbers stay small however far the robot is from the world's origin.
//! A floating root's first six velocities are here `(w, p_dot)` and their derivatives the spatial acceleration
//! `(w_dot, p_ddot - w x p_dot)`; [`to_local`] and [`to_world`] convert from and to a state's twist.
//!
//! Nothing allocates but [`Data::new`], [`Factor::new`], [`TreeFactor::new`] and what makes [`Derivatives`].

use nalgebra::{Vector3, Vector6};

mod aba;
mod crba;
mod data;
mod derivatives;
mod jacobian;
mod kinematics;
mod ltl;
mod rnea;
mod totals;
mod tree;

pub use aba::aba;
pub use crba::crba;
pub use data::Data;
pub use derivatives::Derivatives;
pub use jacobian::{com_jacobian, frame_jacobian, jacobian};
pub use kinematics::{
    frame_pose, frame_velocity, inertias, kinematics, kinematics_about, link_pose, move_twist, point_position, root_position, to_local,
    to_world,
};
pub use ltl::Factor;
pub use rnea::{bias, inverse_dynamics, rnea, velocities};
pub use totals::{Totals, totals};
pub use tree::TreeFactor;

/// Both words of a spatial vector in one.
#[inline]
fn stack(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}
