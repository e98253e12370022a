//! Proximal policy optimisation (Schulman et al. 2017) as the paper's policies were trained: rl_games' continuous actor and
//! critic, with running normalisation of observations and returns, generalised advantages, clipped ratio (and value, if asked
//! for: see [`PpoConfig::value_clip`]), a learning rate that follows the divergence, and value bootstrapping at time-outs.
//!
//! Unlike there, moments of observations move after an update, not before it, so that its first ratio is 1. The shipped policies
//! were trained in the order of rl_games.
//!
//! Networks are small and environments many, so all of it is plain f32 on the CPU, over the engine of programs
//! ([`nerd_model::program::cpu`]): an update of 65 536 steps costs tenths of a second on two cores. Where the simulator is on a GPU, so
//! are answers and updates. Whatever the number of threads, the same seed gives the same bytes.
//!
//! Beside it there is SHAC ([`Shac`]), which learns from slopes in place of samples, in the same runs and folders.
//!
//! An [`Engine`] steps episodes, judges what came of it (`gae.rs`) and learns from it (`update.rs`, by `loss.rs`); [`Trainer`] repeats it
//! and keeps all that a run needs to go on; [`PolicyRun`] does it in a folder, [`play()`] plays the result.

mod arena;
mod checkpoint;
mod config;
mod cpu;
#[cfg(feature = "cuda")]
mod cuda;
mod engine;
mod export;
pub mod folder;
mod gae;
mod loss;
mod noise;
mod normalizer;
mod pilot;
mod play;
mod policy;
mod rollout;
mod run;
mod shac;
mod stack;
mod trainer;
mod update;

pub use nerd_model::program::Activation;
use nerd_tasks::named;

use crate::prelude::*;
use gae::advantages;
use noise::drawn;
use update::orders;

pub use arena::{Arena, Make};
pub use config::{Algorithm, PpoConfig};
pub use cpu::OnCpu;
#[cfg(feature = "cuda")]
pub use cuda::{CudaEngine, CudaEpisodes, CudaShac, Shown};
pub use engine::{Engine, Stage, Turns};
pub use gae::{TERMINATED, TRUNCATED};
pub use loss::Terms;
pub use noise::StreamKey;
pub use normalizer::{RunningMoments, WIDEST};
pub use pilot::Policies;
pub use play::{Game, play};
pub use policy::{Actor, Answer, Policy, Shape};
pub use rollout::{Ended, Rollout, Running, Taken};
pub use run::{Learned, PolicyRun};
pub use shac::Shac;
pub use stack::Stack;
pub use trainer::{Iteration, State, Trainer};
pub use update::{Adam, Updated};
