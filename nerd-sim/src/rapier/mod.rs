//! rapier's reduced-coordinate multibodies behind [`crate::solver::Solver`], set up so that the next state is a
//! function of state, torques and scene alone: every frame starts from a fresh world, so no warm start, contact cache or
//! sleep state is carried over.
//!
//! What is the same as in [`crate::articulated`]: inertias, armature, joint damping, the spring law of limits, the places
//! at which contact is looked for, the mean friction coefficient of a pair. What is not: contacts are rapier's stiff
//! unilateral constraints (no [`crate::scene::Material`] stiffness or damping), and the integrator is of first order.

mod config;
mod frame;
mod solver;
mod template;

pub use config::{FrictionModel, RapierConfig};
pub use solver::Rapier;
