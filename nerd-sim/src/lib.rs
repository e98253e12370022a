#![doc = include_str!("../README.md")]

pub mod articulated;
pub mod batch;
pub mod bodies;
pub mod cable;
#[cfg(feature = "calibrate")]
pub mod calibrate;
mod collider;
mod columns;
pub mod control;
pub mod dataset;
mod derive;
pub mod drive;
pub mod files;
mod identity;
pub mod instruments;
mod limits;
#[cfg(feature = "csv")]
pub mod log;
mod material;
#[cfg(feature = "measured")]
pub mod measured;
mod merge;
#[cfg(feature = "meshes")]
pub mod meshes;
#[cfg(feature = "mjcf")]
pub mod mjcf;
mod parallel;
pub mod range;
#[cfg(feature = "rapier")]
pub mod rapier;
#[cfg(feature = "csv")]
pub mod rollout;
pub mod sampling;
pub mod scene;
pub mod solver;
pub mod source;
pub mod spec;
mod spread;
mod srdf;
#[cfg(feature = "suite")]
pub mod suite;
pub mod survey;
pub mod system;
#[cfg(feature = "csv")]
pub mod table;
pub mod truth;
mod validate;
pub mod vary;
pub mod worlds;

pub use nerd_core;
pub use parry3d_f64 as parry;

/// What most programs need.
pub mod prelude {
    pub use crate::articulated::{Articulated, ArticulatedConfig, ContactStep, Friction, Integrator, Refresh};
    pub use crate::batch::Batch;
    pub use crate::control::Controller;
    pub use crate::drive::Drive;
    #[cfg(feature = "rapier")]
    pub use crate::rapier::{Rapier, RapierConfig};
    pub use crate::scene::{Collider, Material, Plane, Scene};
    pub use crate::solver::{Simulation, Solver, StepError};
    pub use crate::system::{System, SystemError};
    pub use crate::truth::Truth;
}
