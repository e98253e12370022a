//! Planners: actions for episodes in one solver, found by looking ahead in another (a model, or a cheaper method).
//!
//! ```
//! use nerd_sim::prelude::*;
//! use nerd_tasks::plan::{Mppi, MppiConfig, Planner};
//! use nerd_tasks::{Episodes, named};
//!
//! let system = System::named("cartpole")?;
//! let episodes = |n: usize, method: ArticulatedConfig| -> Result<Episodes, Box<dyn std::error::Error>> {
//!     let batch = Batch::new(&system, &system.scene("free")?, n);
//!     Ok(Episodes::new(named("cartpole-swingup")?, Simulation::new(batch, Articulated::new(method)), 0))
//! };
//! let config = MppiConfig { samples: 32, ..MppiConfig::default() };
//! let mut planner = Mppi::new(episodes(32, ArticulatedConfig::explicit(1, Friction::Coulomb))?, config);
//! let mut truth = episodes(1, ArticulatedConfig::accurate(&system))?;
//! let actions = planner.act(&truth)?;
//! let reward = truth.step(&actions)?.rewards[0];
//! # assert!(reward.is_finite());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod ahead;
mod ilqr;
mod linear;
mod mppi;

pub use ilqr::{Ilqr, IlqrConfig};
pub use mppi::{Mppi, MppiConfig};

use nerd_sim::solver::StepError;

use crate::Episodes;

/// Finds actions by looking ahead.
pub trait Planner: Send {
    /// Actions `[env][action]`, each in [-1, 1], for the episodes where they are now. A plan goes on from call to call; that of an episode
    /// which has just begun begins anew.
    ///
    /// # Errors
    /// If the episodes are of another robot or task, or the solver that looks ahead fails.
    fn act(&mut self, present: &Episodes) -> Result<Vec<f64>, StepError>;
}
