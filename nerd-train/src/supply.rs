//! Replaces the oldest shards of a run's data with fresh shards, recorded in the background.
//!
//! A network that sees ten million transitions seventy times overfits. A pendulum's loss was 8e-4 on its training data
//! and 4e-3 on new data. The settings alone determine which update replaces which shard, so a resumed run sees the same
//! data. If recording is too slow, the learner waits.

use std::sync::mpsc::{Receiver, sync_channel};

use crate::prelude::*;
use crate::prepare::{MakeSolver, normalize, shard};

/// Settings of the supply of fresh data.
pub struct SupplyConfig {
    /// Settings of the recording at the start of the run, a whole number of shards. Numbers of fresh trajectories
    /// follow those of this recording.
    pub data: GenerateConfig,
    /// Number of fresh shards in the whole run.
    pub shards: u64,
    /// Number of updates of the whole run; fresh shards are spread evenly over them.
    pub updates: u64,
    /// Number of updates done before this start; above 0 in a resumed run.
    pub step: u64,
    /// Number of tokens in a window.
    pub history: usize,
    /// Content of tokens, and base of targets.
    pub form: Form,
    /// Normaliser of tokens and targets, constant over the whole run.
    pub normalizer: Normalizer,
}

/// Yields fresh shards of data in the order in which they are due.
pub struct Supply {
    config: Arc<SupplyConfig>,
    /// By recording thread, its fresh shards in order. Of T threads, thread t records the shards t, t + T, t + 2 T, ..
    recorders: Vec<Receiver<Result<Windows, DatasetError>>>,
    /// Number of shards in the data, called slots. Fresh shard k replaces the shard in slot k modulo `slots`.
    slots: u64,
    /// Number of the fresh shard that [`Supply::take`] returns next.
    next: u64,
}

impl Supply {
    /// Starts one recording thread per rayon thread. The recording threads stop when the supply is dropped.
    ///
    /// # Errors
    /// If recording is refused, the data is less than a shard, or a thread cannot be started.
    pub fn new(
        system: &Arc<System>,
        solver: impl Fn() -> Box<dyn Solver> + Send + Sync + 'static,
        config: SupplyConfig,
    ) -> Result<Self> {
        config.data.check(system)?;
        let trajectories = config.data.trajectories();
        let shard = config.data.shard_trajectories;
        if trajectories < shard {
            let text = format!("{trajectories} trajectories of data are less than a shard of {shard} trajectories");
            return Err(DatasetError::Config(text).into());
        }
        let threads = rayon::current_num_threads() as u64;
        let slots = (trajectories / shard) as u64;
        let solver = Arc::new(solver);
        let mut supply = Self { recorders: Vec::new(), slots, next: 0, config: Arc::new(config) };
        // A resumed run begins with the last fresh shard of each slot, which replaced all earlier shards there.
        let first = supply.due(supply.config.step).saturating_sub(slots);
        supply.next = first;
        for thread in 0..threads {
            let (sender, receiver) = sync_channel(1);
            let system = system.clone();
            let solver = solver.clone();
            let config = supply.config.clone();
            // The first shard k >= first with k % threads == thread.
            let mut k = first + (thread + threads - first % threads) % threads;
            let work = move || {
                while k < config.shards {
                    let made = fresh_shard(&system, &*solver, &config, k);
                    let failed = made.is_err();
                    if sender.send(made).is_err() || failed {
                        return;
                    }
                    k += threads;
                }
            };
            // In a pool of one thread, solvers with internal parallelism take no threads from the run.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
            pool.map_err(|e| format!("fresh data: {e}"))?.spawn(work);
            supply.recorders.push(receiver);
        }
        Ok(supply)
    }

    /// Waits for the next shard due before update `step`. Returns the number of the first trajectory that it replaces,
    /// and the shard; `None` if no shard is due.
    pub fn take(&mut self, step: u64) -> Option<Result<(usize, Windows)>> {
        if self.next >= self.due(step) {
            return None;
        }
        let k = self.next;
        self.next += 1;
        let place = (k % self.slots) as usize * self.config.data.shard_trajectories;
        let made = self.recorders[(k % self.recorders.len() as u64) as usize].recv();
        let made =
            made.unwrap_or_else(|_| Err(DatasetError::Config("a thread that records fresh data panicked".into())));
        Some(made.map(|windows| (place, windows)).map_err(Error::from))
    }

    /// Number of fresh shards due before update `step`.
    fn due(&self, step: u64) -> u64 {
        let SupplyConfig { shards, updates, .. } = &*self.config;
        (u128::from(*shards) * u128::from(step) / u128::from((*updates).max(1))) as u64
    }
}

/// Records fresh shard `k`; returns it as normalised windows.
fn fresh_shard(
    system: &Arc<System>,
    solver: &MakeSolver,
    config: &SupplyConfig,
    k: u64,
) -> Result<Windows, DatasetError> {
    let count = config.data.shard_trajectories;
    let first = config.data.trajectories() as u64 + k * count as u64;
    let (mut windows, _) = shard(system, solver, &config.data, first, count, (config.history, config.form))?;
    normalize(&mut windows, &config.normalizer);
    Ok(windows)
}
