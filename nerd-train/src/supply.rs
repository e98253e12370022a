//! Fresh data while a run goes on: shards recorded in the background take the places of the oldest.
//!
//! A network that meets ten million transitions seventy times learns them by heart: a pendulum's loss was 8e-4 on its
//! data and 4e-3 on new data. A simulator need not repeat itself. Which shard is taken up before which update follows
//! from the settings alone, so a resumed run learns from what the unbroken one would have; where the cores cannot keep
//! up the learner waits.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

use nerd_model::form::Form;
use nerd_model::normalizer::Normalizer;
use nerd_sim::dataset::{DatasetError, GenerateConfig};
use nerd_sim::solver::Solver;
use nerd_sim::system::System;

use crate::prepare::{normalize, shard};
use crate::windows::Windows;

/// What to record, and when it is wanted.
pub struct SupplyConfig {
    /// The data that the run starts with, in whole shards; fresh ones go on where it ends.
    pub data: GenerateConfig,
    /// Fresh shards over the whole run.
    pub shards: u64,
    /// Updates of the whole run, over which they come evenly.
    pub updates: u64,
    /// Updates done before, in a resumed run.
    pub step: u64,
    /// Tokens in a window.
    pub history: usize,
    /// What tokens and targets hold.
    pub form: Form,
    /// Of the run.
    pub normalizer: Normalizer,
}

/// Why there is no fresh data.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SupplyError {
    /// It could not be recorded.
    #[error("fresh data: {0}")]
    Dataset(#[from] DatasetError),
    /// No thread could be started.
    #[error("fresh data: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A thread panicked; it has said why.
    #[error("fresh data: a recording thread panicked")]
    Panicked,
}

/// Fresh shards in order.
pub struct Supply {
    /// Thread t makes every T-th shard.
    threads: Vec<Receiver<Result<Windows, DatasetError>>>,
    slots: u64,
    shard: usize,
    shards: u64,
    updates: u64,
    next: u64,
}

impl Supply {
    /// Starts recording on as many threads as rayon has; they stop when the supply is dropped.
    ///
    /// # Errors
    /// If the data cannot be made, or are less than a shard; or a thread cannot be started.
    pub fn new(
        system: &Arc<System>,
        solver: impl Fn() -> Box<dyn Solver> + Send + Sync + 'static,
        config: SupplyConfig,
    ) -> Result<Self, SupplyError> {
        config.data.check(system)?;
        let shard = config.data.shard_trajectories;
        let slots = (config.data.trajectories() / shard) as u64;
        if slots == 0 {
            let text = format!("{} trajectories are less than a shard of {shard}", config.data.trajectories());
            return Err(DatasetError::Config(text).into());
        }
        let mut supply = Self { threads: Vec::new(), slots, shard, shards: config.shards, updates: config.updates.max(1), next: 0 };
        // Of what is past only the last of each slot is left.
        supply.next = supply.wanted(config.step).saturating_sub(slots);
        let (shared, threads) = (Arc::new((config, solver)), rayon::current_num_threads() as u64);
        for thread in 0..threads {
            let (sender, receiver) = sync_channel(1);
            // The thread that makes shard k is k mod T.
            let mut k = supply.next + (thread + threads - supply.next % threads) % threads;
            let (system, shared, shards) = (system.clone(), shared.clone(), supply.shards);
            let work = move || {
                while k < shards {
                    let made = make(&system, &shared.1, &shared.0, k);
                    let failed = made.is_err();
                    if sender.send(made).is_err() || failed {
                        return;
                    }
                    k += threads;
                }
            };
            // A pool of one thread, so that solvers which are parallel by themselves stay on it and out of the run's way.
            rayon::ThreadPoolBuilder::new().num_threads(1).build()?.spawn(work);
            supply.threads.push(receiver);
        }
        Ok(supply)
    }

    /// The next shard that is to be taken up before update `step`, with the number of the first trajectory whose place it
    /// takes; waits for it. None once all are.
    pub fn take(&mut self, step: u64) -> Option<Result<(usize, Windows), SupplyError>> {
        if self.next >= self.wanted(step) {
            return None;
        }
        let k = self.next;
        self.next += 1;
        let place = (k % self.slots) as usize * self.shard;
        let made = self.threads[(k % self.threads.len() as u64) as usize].recv();
        Some(made.map_or_else(|_| Err(SupplyError::Panicked), |made| made.map_err(SupplyError::from)).map(|windows| (place, windows)))
    }

    /// Shards taken up by the time of update `step`.
    fn wanted(&self, step: u64) -> u64 {
        (u128::from(self.shards) * u128::from(step) / u128::from(self.updates)) as u64
    }
}

fn make(system: &Arc<System>, solver: &(dyn Fn() -> Box<dyn Solver> + Sync), c: &SupplyConfig, k: u64) -> Result<Windows, DatasetError> {
    let count = c.data.shard_trajectories;
    let first = c.data.trajectories() as u64 + k * count as u64;
    let (mut windows, _) = shard(system, solver, &c.data, first, count, (c.history, c.form))?;
    normalize(&mut windows, &c.normalizer);
    Ok(windows)
}
