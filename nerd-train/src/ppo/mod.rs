//! Proximal policy optimisation (PPO, Schulman et al. 2017) with the settings of the paper's policies: rl_games'
//! continuous actor-critic. Observations and returns have running normalisers, advantages come from GAE, and time-outs
//! bootstrap the value. The probability ratio is clipped, and the value too if [`PpoConfig::value_clip`] is set. The
//! learning rate adapts to the KL divergence.
//!
//! Unlike in rl_games, the observation normaliser absorbs a rollout only after its update. So the first probability
//! ratio of an update is 1. The shipped policies were trained in the order of rl_games.
//!
//! Networks are small and environments many, so PPO runs in plain f32 on the CPU ([`nerd_model::program::cpu`]). An
//! update of 65 536 steps costs tenths of a second on two cores. With a simulator on a GPU, policy and updates run
//! there too. The same seed gives the same bytes for any number of threads.
//!
//! SHAC ([`Shac`]) learns from gradients of the simulator instead of samples. Its runs and folders have the form of
//! PPO's.
//!
//! An [`Engine`] steps episodes, estimates advantages (`gae.rs`) and updates the policy (`update.rs`, loss in
//! `loss.rs`). [`Trainer`] repeats this and holds the state of the run, [`PolicyRun`] runs it in a folder, [`play()`]
//! plays the result.

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
pub use engine::{Engine, RolloutInput, StepwiseRollout};
pub use gae::{TERMINATED, TRUNCATED};
pub use loss::Terms;
pub use noise::StreamKey;
pub use normalizer::{RunningMoments, WIDEST};
pub use pilot::Policies;
pub use play::{Game, play};
pub use policy::{Actor, Policy, PolicyOutput, Shape};
pub use rollout::{Ended, Rollout, RolloutStats, Running};
pub use run::{Learned, PolicyRun};
pub use shac::Shac;
pub use stack::Stack;
pub use trainer::{Iteration, State, Trainer};
pub use update::{Adam, Updated};
