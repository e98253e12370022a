//! Fresh data during a run: shards recorded in the background replace the oldest shards.
//!
//! A network that sees ten million transitions seventy times overfits: a pendulum's loss was 8e-4 on its data and 4e-3
//! on new data. The settings alone determine which update replaces which shard, so a resumed run sees the same data. If
//! recording is too slow, the learner waits.

use std::sync::mpsc::{Receiver, sync_channel};

use crate::prelude::*;
use crate::prepare::{MakeSolver, normalize, shard};

/// Settings of a supply.
pub struct SupplyConfig {
    /// The data at the start of the run, in whole shards. Fresh trajectories continue its numbering.
    pub data: GenerateConfig,
    /// Number of fresh shards in the whole run.
    pub shards: u64,
    /// Updates of the whole run; fresh shards are spread evenly over them.
    pub updates: u64,
    /// Updates done before, in a resumed run.
    pub step: u64,
    /// Tokens in a window.
    pub history: usize,
    /// Form of tokens and targets.
    pub form: Form,
    /// The run's normaliser.
    pub normalizer: Normalizer,
}

/// Yields fresh shards in order.
pub struct Supply {
    config: Arc<SupplyConfig>,
    /// Thread t records every T-th shard.
    threads: Vec<Receiver<Result<Windows, DatasetError>>>,
    slots: u64,
    next: u64,
}

impl Supply {
    /// Starts one recording thread per rayon thread; they stop when the supply is dropped.
    ///
    /// # Errors
    /// If recording is refused, the data is less than a shard, or a thread cannot be started.
    pub fn new(
        system: &Arc<System>,
        solver: impl Fn() -> Box<dyn Solver> + Send + Sync + 'static,
        config: SupplyConfig,
    ) -> Result<Self> {
        config.data.check(system)?;
        let (trajectories, shard) = (config.data.trajectories(), config.data.shard_trajectories);
        if trajectories < shard {
            return Err(
                DatasetError::Config(format!("{trajectories} trajectories are less than a shard of {shard}")).into()
            );
        }
        let threads = rayon::current_num_threads() as u64;
        let (config, solver, slots) = (Arc::new(config), Arc::new(solver), (trajectories / shard) as u64);
        let mut supply = Self { threads: Vec::new(), slots, next: 0, config };
        // Of earlier shards, only the last one in each slot is still in use.
        let first = supply.wanted(supply.config.step).saturating_sub(slots);
        supply.next = first;
        for thread in 0..threads {
            let (sender, receiver) = sync_channel(1);
            let (system, solver, config) = (system.clone(), solver.clone(), supply.config.clone());
            let mut k = first + (thread + threads - first % threads) % threads;
            let work = move || {
                while k < config.shards {
                    let made = make(&system, &*solver, &config, k);
                    let failed = made.is_err();
                    if sender.send(made).is_err() || failed {
                        return;
                    }
                    k += threads;
                }
            };
            // A pool of one thread keeps solvers with internal parallelism out of the run's way.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
            pool.map_err(|e| format!("fresh data: {e}"))?.spawn(work);
            supply.threads.push(receiver);
        }
        Ok(supply)
    }

    /// The next shard due before update `step`, and the number of the first trajectory that it replaces. Waits for the
    /// recording; none if no shard is due.
    pub fn take(&mut self, step: u64) -> Option<Result<(usize, Windows)>> {
        if self.next >= self.wanted(step) {
            return None;
        }
        let j = self.next;
        self.next += 1;
        let place = (j % self.slots) as usize * self.config.data.shard_trajectories;
        let made = self.threads[(j % self.threads.len() as u64) as usize].recv();
        let made =
            made.unwrap_or_else(|_| Err(DatasetError::Config("a thread that records fresh data panicked".into())));
        Some(made.map(|windows| (place, windows)).map_err(Error::from))
    }

    /// Number of fresh shards due before update `step`.
    fn wanted(&self, step: u64) -> u64 {
        let SupplyConfig { shards, updates, .. } = &*self.config;
        (u128::from(*shards) * u128::from(step) / u128::from((*updates).max(1))) as u64
    }
}

fn make(system: &Arc<System>, solver: &MakeSolver, c: &SupplyConfig, k: u64) -> Result<Windows, DatasetError> {
    let count = c.data.shard_trajectories;
    let first = c.data.trajectories() as u64 + k * count as u64;
    let (mut windows, _) = shard(system, solver, &c.data, first, count, (c.history, c.form))?;
    normalize(&mut windows, &c.normalizer);
    Ok(windows)
}
