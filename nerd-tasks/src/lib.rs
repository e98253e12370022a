#![doc = include_str!("../README.md")]

mod ant;
mod anymal;
pub mod body;
mod cartpole_swingup;
mod drape;
mod episodes;
pub mod formula;
mod franka_reach;
mod lead_tip;
pub mod plan;
mod registry;
mod snapshot;
mod task;

pub use ant::Ant;
pub use anymal::Anymal;
pub use cartpole_swingup::CartpoleSwingup;
pub use episodes::{Episodes, StepResult};
pub use franka_reach::FrankaReach;
pub use lead_tip::LeadTip;
pub use registry::{TaskError, named, names};
pub use snapshot::{Beginning, Snapshot, Trace};
pub use task::{About, Slopes, Task, View, Work, fast_start};

pub use nerd_sim;
pub use rand;
pub use rand_chacha::ChaCha8Rng;
