//! The paper's second test case: how far the rewards of running policies in a model are from those in the truth.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use nerd_train::ppo::{Policy, folder};

use nerd_sim::truth::Truth;
use nerd_train::experiments::games::{Place, Reward, games as reward, gap};
use nerd_train::shipped::folders;

use crate::common::Device;

/// What they run for.
const TASK: &str = "ant-run";
/// Where they lie: as in the paper, those trained in a learned simulator.
const FOLDER: &str = "models/policies";
const PREFIX: &str = "ant-run-neural-";
/// Seed of the games' starts.
const SEED: u64 = 500;

/// Shipped running policies with their mean rewards in the truth.
pub struct Runners {
    games: usize,
    policies: Vec<(Policy, f64)>,
}

impl Runners {
    /// Plays them in the truth.
    pub fn new(games: usize) -> Result<Self> {
        let folders = folders(Path::new(FOLDER), PREFIX)?;
        if folders.is_empty() {
            bail!("{FOLDER} has no {PREFIX}*: train one with `cargo xtask policy train {TASK} --solver neural`");
        }
        let play = |path: &PathBuf| {
            let (_, policy) = folder::load(path)?;
            let real = Reward::of(&reward(TASK, Place::Truth(Truth::Articulated), &policy, games, SEED)?).mean;
            Ok((policy, real))
        };
        Ok(Self { games, policies: folders.iter().map(play).collect::<Result<_>>()? })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.policies.len()
    }

    /// Mean over the policies of |reward in the model - in the truth| over the latter.
    pub fn gap(&self, model: &Path, device: Device) -> Result<f64> {
        let gaps = self.policies.iter().map(|(policy, real)| {
            let learned = Reward::of(&reward(TASK, Place::Model(model, device), policy, self.games, SEED)?).mean;
            Ok(gap(*real, learned).abs() / 100.0)
        });
        Ok(gaps.sum::<Result<f64>>()? / self.policies.len() as f64)
    }
}
