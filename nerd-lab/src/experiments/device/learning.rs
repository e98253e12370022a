//! How fast policies learn in learned simulators on the device.

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::report::table::digits;
use nerd_train::ppo::{Arena, PpoConfig, on_card};

/// Iterations that are timed, after two that are not.
const ITERATIONS: usize = 8;

/// One task.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Learning {
    /// The task.
    pub task: String,
    /// Where it is learned.
    #[serde(default)]
    pub solver: String,
    /// Environments, and steps of an iteration.
    pub sizes: [usize; 2],
    /// Steps a second of all environments, updates included.
    pub steps: f64,
    /// Shares of the time: rollout, update.
    pub shares: [f64; 2],
    /// Memory of the device that it took (GiB).
    #[serde(default)]
    pub memory: f64,
}

/// Trains for a few iterations in an arena on the device, at the paper's settings but for the number of environments.
pub(super) fn measure(task: &str, arena: &Arena, environments: usize, seed: u64) -> Result<Learning> {
    let config = PpoConfig { environments, ..PpoConfig::of(task)? };
    let had = free()?;
    let mut trainer = on_card(arena, nerd_tasks::named(task)?, &config, seed, &Arc::default())?;
    // Kernels are compiled and memory taken once.
    (0..2).try_for_each(|_| trainer.iterate().map(drop))?;
    let (began, mut rollout, mut update) = (Instant::now(), 0.0, 0.0);
    for _ in 0..ITERATIONS {
        let line = trainer.iterate()?;
        rollout += line.rollout_seconds;
        update += line.update_seconds;
    }
    let all = began.elapsed().as_secs_f64();
    let memory = (had as f64 - free()? as f64) / f64::from(1 << 30);
    let shares = [rollout, update].map(|seconds| seconds / all);
    Ok(Learning {
        task: task.into(),
        solver: arena.title()?,
        sizes: [environments, config.steps()],
        steps: (ITERATIONS * config.steps()) as f64 / all,
        shares,
        memory,
    })
}

/// Bytes of the device that nobody has taken.
fn free() -> Result<usize> {
    nerd_cuda::Device::free().map_err(|e| Error::msg(e.to_string()))
}

impl Learning {
    /// A row of the table.
    pub(super) fn cells(&self) -> Vec<String> {
        let [environments, steps] = self.sizes.map(|n| n.to_string());
        let shares = self.shares.map(|share| format!("{:.0}", 100.0 * share));
        let head = [self.task.clone(), self.solver.clone(), environments, steps, digits(self.steps)];
        head.into_iter().chain(shares).chain([format!("{:.1}", self.memory)]).collect()
    }
}
