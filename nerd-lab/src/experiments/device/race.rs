//! What policies earn in the truth that learned for so long in the learned simulator on the device.

use std::path::Path;

use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::super::games::{Reward, games, gap, gap_error};
use crate::error::{Result, refuse};
use crate::report::table::digits;
use nerd_train::device::Device;
use nerd_train::ppo::{Arena, PolicyRun, PpoConfig, folder};
use nerd_train::shipped;

/// Games that each policy plays.
const GAMES: usize = 100;

/// One policy.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Race {
    /// Its task.
    pub task: String,
    /// Its seed.
    pub seed: u64,
    /// Seconds in which it learned, kernels compiled and all.
    pub seconds: f64,
    /// Environments.
    pub environments: usize,
    /// Steps of all of them.
    pub steps: u64,
    /// In the learned simulator.
    pub learned: Reward,
    /// In the truth.
    pub real: Reward,
    /// Gap (%) and its standard error.
    pub gap: [f64; 2],
}

/// Trains at the paper's settings for so many seconds, in a folder of `runs`, and plays in the truth.
pub(super) fn run(task: &str, seconds: f64, seed: u64, runs: &Path) -> Result<Race> {
    let model = shipped::model_of_task(task, nerd_tasks::named(task)?.robot());
    let arena = Arena::Model { folder: model, device: Device::Cuda };
    // Time ends it, not a number of iterations.
    let config = PpoConfig { iterations: 1_000_000, ..PpoConfig::of(task)? };
    let (environments, out) = (config.environments, runs.join(format!("{task}-{seed}")));
    if out.exists() {
        refuse!("{} holds a run, and a race begins with nothing: remove it, or name another folder of `runs`", out.display());
    }
    let (minutes, steps) = (Some(seconds / 60.0), config.steps() as u64);
    let learned = PolicyRun { task: task.into(), arena: arena.clone(), config, seed, until: None, minutes, out }.train()?;
    let (_, policy) = folder::load(&learned.policy)?;
    let play = |arena: &Arena| games(task, arena, &policy, GAMES, seed);
    let (real, neural) = (play(&Arena::Truth(Truth::Articulated))?, play(&arena)?);
    let (truth, imagined) = (Reward::of(&real), Reward::of(&neural));
    let gap = [gap(truth.mean, imagined.mean), gap_error(&real, &neural)];
    let steps = learned.iterations * steps;
    Ok(Race { task: task.into(), seed, seconds: learned.elapsed.as_secs_f64(), environments, steps, learned: imagined, real: truth, gap })
}

impl Race {
    /// A row of the table.
    pub(super) fn cells(&self) -> Vec<String> {
        let [gap, error] = self.gap;
        let reward = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.standard_error);
        vec![
            self.task.clone(),
            self.seed.to_string(),
            digits(self.seconds),
            self.environments.to_string(),
            digits(self.steps as f64),
            reward(&self.real),
            reward(&self.learned),
            format!("{gap:+.2} +- {error:.2}"),
        ]
    }
}
