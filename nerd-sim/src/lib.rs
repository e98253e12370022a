#![doc = include_str!("../README.md")]

#[cfg(feature = "csv")]
mod arrays;
pub mod articulated;
pub mod batch;
#[cfg(feature = "calibrate")]
pub mod calibrate;
pub mod control;
pub mod dataset;
pub mod disturb;
pub mod drive;
pub mod files;
pub mod instruments;
mod internal;
#[cfg(feature = "csv")]
pub mod log;
pub mod mjcf;
mod random;
pub mod range;
#[cfg(feature = "rapier")]
pub mod rapier;
pub mod rig;
mod robots;
#[cfg(feature = "csv")]
pub mod rollout;
pub mod sampling;
pub mod scene;
pub mod solver;
pub mod system;
#[cfg(feature = "csv")]
pub mod table;
pub mod trajectories;
pub mod truth;
pub mod vary;

pub use nerd_core;
pub use parry3d_f64 as parry;
pub use robots::cable;

/// Types and functions that most programs need, including nerd-core's prelude.
pub mod prelude {
    pub use std::sync::Arc;

    pub use nerd_core::prelude::*;

    pub use crate::articulated::{Articulated, ArticulatedConfig, ContactStep, Friction, Integrator, Refresh};
    pub use crate::batch::{Batch, BatchError};
    #[cfg(feature = "rapier")]
    pub use crate::rapier::{Rapier, RapierConfig};
    pub use crate::sampling::{Start, start, stream};
    pub use crate::scene::{Collider, GRAVITY, Material, Plane, Scene};
    pub use crate::solver::{Capabilities, Simulation, Solver, StepError};
    pub use crate::system::contacts;
    pub use crate::system::{System, SystemError};
    pub use crate::truth::Truth;
    pub use crate::{control::Controller, drive::Drive, range::Range};
}
