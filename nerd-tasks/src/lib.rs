#![doc = include_str!("../README.md")]

mod ant;
mod anymal;
pub mod body;
mod cartpole_swingup;
pub mod device;
mod drape;
mod episodes;
mod fast;
pub mod formula;
mod franka_reach;
mod lead_tip;
mod memory;
mod registry;
mod task;

pub use ant::Ant;
pub use anymal::Anymal;
pub use cartpole_swingup::CartpoleSwingup;
pub use episodes::{Episodes, StepResult};
pub use fast::{Fast, fast_start};
pub use franka_reach::FrankaReach;
pub use lead_tip::LeadTip;
pub use memory::Snapshot;
pub use registry::{TaskError, named, names};
pub use task::{Task, View, Work};

pub use nerd_sim;
pub use rand;
pub use rand_chacha::ChaCha8Rng;
