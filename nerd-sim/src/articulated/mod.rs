//! Our own articulated dynamics: RNEA, CRBA and Cholesky from nerd-core, geometry from the scene.
//!
//! With nothing to touch a frame is integrated by RK4 or symplectic Euler; with contact by sub-stepped symplectic
//! Euler under the compliant contact of [`force`], or by substeps that look ahead ([`ContactStep::Implicit`]). A frame
//! in which a joint's damper or limit is too stiff for an explicit substep takes implicit ones under any preset, and one in which an
//! implicit step gives energy more of them. Models and policies learn
//! from preset `accurate`; `paper` reproduces the reference simulator; `converged` measures errors. An environment without collider or
//! contact point runs no contact code.

mod along;
mod config;
pub mod device;
mod energy;
mod explicit;
mod find;
mod fold;
pub mod force;
mod frame;
mod implicit;
mod kept;
mod kick;
mod memory;
mod slopes;
mod solver;
mod spin;
mod stiff;
mod touch;
mod touches;
mod workspace;

pub use crate::system::Refresh;
pub use along::along;
pub use config::{ArticulatedConfig, ContactStep, Friction, Integrator};
pub use slopes::numbers;
pub use solver::Articulated;
