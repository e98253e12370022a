//! Shipped running policies, played in every variant: how near to the truth a model is where policies go.

use std::path::{Path, PathBuf};

use nerd_sim::truth::Truth;
use nerd_train::device::Device;
use nerd_train::ppo::{Arena, Policy};
use nerd_train::shipped::{self, from_root};
use serde::{Deserialize, Serialize};

use super::super::games::{Reward, games, policy_of};
use crate::error::{Result, refuse};

const TASK: &str = "ant-run";

/// One policy in one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Played {
    /// Its folder.
    pub policy: String,
    /// In the truth.
    pub real: Reward,
    /// In the model.
    pub learned: Reward,
}

/// Shipped running policies that were trained in a learned simulator, as the paper's.
///
/// # Errors
/// If they cannot be read, or there is none.
pub(super) fn runners() -> Result<Vec<PathBuf>> {
    let found = shipped::policies(&format!("{TASK}-neural-"))?;
    if found.is_empty() {
        refuse!("models/policies has no {TASK}-neural-*: train one with `cargo xtask policy train {TASK} --solver neural`");
    }
    Ok(found)
}

/// A policy that was played in the truth.
pub(super) struct Runner {
    path: PathBuf,
    policy: Policy,
    real: Reward,
}

impl Runner {
    /// Plays it in the truth.
    pub(super) fn new(path: PathBuf, n: usize, seed: u64) -> Result<Self> {
        let policy = policy_of(&path, TASK)?;
        let real = Reward::of(&games(TASK, &Arena::Truth(Truth::Articulated), &policy, n, seed)?);
        Ok(Self { path, policy, real })
    }

    /// Plays it in a model.
    pub(super) fn play(&self, model: &Path, device: Device, n: usize, seed: u64) -> Result<Played> {
        let arena = Arena::Model { folder: model.into(), device };
        let learned = Reward::of(&games(TASK, &arena, &self.policy, n, seed)?);
        Ok(Played { policy: from_root(&self.path), real: self.real, learned })
    }
}
