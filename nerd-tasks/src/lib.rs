#![doc = include_str!("../README.md")]

pub mod ant;
mod ant_run;
mod ant_spin;
mod ant_spin_track;
pub mod anymal;
mod anymal_forward;
mod anymal_side;
pub mod body;
mod cartpole_swingup;
mod drape;
mod episodes;
mod fast;
mod franka_reach;
mod lead_tip;
mod memory;
mod registry;
mod task;

pub use ant_run::ANT_RUN;
pub use ant_spin::ANT_SPIN;
pub use ant_spin_track::ANT_SPIN_TRACK;
pub use anymal_forward::ANYMAL_FORWARD;
pub use anymal_side::ANYMAL_SIDE;
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
