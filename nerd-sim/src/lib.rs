//! Simulation: systems (a robot and what URDF cannot say of it), scenes, batches, and the [`solver::Solver`] that
//! advances a batch by one control frame. Two analytic solvers stand behind that trait: [`articulated`] and, with
//! the feature of that name, `rapier`.
//!
//! The same seed gives the same bytes for any number of threads, on one machine with one build. Across machines it need not:
//! sines come from the platform's library, and rapier is built without its `enhanced-determinism`.
//!
//! ```
//! use nerd_sim::prelude::*;
//! let system = System::named("pendulum")?;
//! let scene = system.scene("ground1")?;
//! let mut batch = Batch::new(&system, &scene, 2);
//! let mut solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
//! solver.step(&mut batch, &[0.0; 4])?;
//! assert!(batch.state(0)[2] < 0.0, "the arm falls");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod articulated;
pub mod batch;
pub mod bodies;
mod collider;
pub mod control;
pub mod dataset;
pub mod files;
mod identity;
pub mod instruments;
pub mod law;
mod limits;
mod material;
#[cfg(feature = "measured")]
pub mod measured;
#[cfg(feature = "mjcf")]
pub mod mjcf;
mod parallel;
#[cfg(feature = "rapier")]
pub mod rapier;
#[cfg(feature = "csv")]
pub mod rollout;
pub mod sampling;
pub mod scene;
pub mod solver;
pub mod spec;
#[cfg(feature = "suite")]
pub mod suite;
pub mod survey;
pub mod system;
#[cfg(feature = "csv")]
pub mod table;
pub mod truth;
mod validate;
pub mod worlds;

/// What most programs need.
pub mod prelude {
    pub use crate::articulated::{Articulated, ArticulatedConfig, ContactStep, Friction, Integrator, Refresh};
    pub use crate::batch::Batch;
    #[cfg(feature = "rapier")]
    pub use crate::rapier::{Rapier, RapierConfig};
    pub use crate::scene::{Collider, Material, Plane, Scene};
    pub use crate::solver::{Simulation, Solver, StepError};
    pub use crate::system::{System, SystemError};
    pub use crate::truth::Truth;
}
