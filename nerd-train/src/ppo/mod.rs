//! Proximal policy optimisation (Schulman et al. 2017) as the paper's policies were trained: rl_games' continuous actor and
//! critic, with running normalisation of observations and returns, generalised advantages, clipped ratio (and value, if asked
//! for: see [`PpoConfig::value_clip`]), a learning rate that follows the divergence, and values in place of what time-outs cut off.
//!
//! Unlike there, moments of observations move after an update, not before it, so that its first ratio is 1. The shipped policies
//! learned in the order of rl_games.
//!
//! Networks are small and environments many, so all of it is plain f32 on the CPU, over the engine of programs ([`nerd_model::program::cpu`]): an update of 65 536
//! steps costs tenths of a second on two cores. Where the simulator is on a GPU, so are answers and updates. Whatever the number of threads,
//! the same seed gives the same bytes.
//!
//! [`rollout`] steps, [`gae`] judges, [`update`] learns by [`loss`], all on an [`Engine`]; [`Trainer`] repeats it and keeps all that a run needs
//! to go on; [`PolicyRun`] does it in a folder, [`play()`] plays the result.

mod arena;
mod card;
mod checkpoint;
pub mod clock;
mod config;
#[cfg(feature = "cuda")]
mod cuda;
pub mod curve;
pub mod engine;
mod environments;
pub mod folder;
pub mod gae;
pub mod loss;
mod normalizer;
mod pilot;
mod play;
mod policy;
pub mod rollout;
mod run;
mod shared;
mod stack;
mod trainer;
pub mod update;

pub use nerd_model::program::Activation;

pub use arena::{Arena, Guest};
pub use config::{ConfigError, PpoConfig};
#[cfg(feature = "cuda")]
pub use cuda::{CudaEngine, World, on_card};
pub use engine::{Engine, OnCpu};
pub use environments::Environments;
pub use normalizer::RunningMoments;
pub use pilot::Policies;
pub use play::{Game, play};
pub use policy::{Actor, Answer, Policy, Shape};
pub use run::{Learned, PolicyRun};
pub use shared::Shared;
pub use stack::Stack;
pub use trainer::{Iteration, PpoError, State, Trainer};
