//! How fast policies learn on a card.

use std::sync::Arc;
use std::time::Instant;

use nerd_model::pick::Setting;
use nerd_train::device::Device;
use nerd_train::ppo::{Arena, PpoConfig};
use nerd_train::shipped;
use serde::Serialize;

use crate::error::Result;
use crate::report::Table;
use crate::report::table::digits;

/// Iterations that are timed, after two that are not.
const ITERATIONS: usize = 8;

#[derive(Clone, Debug, Serialize)]
pub(super) struct Learning {
    task: String,
    solver: String,
    /// Environments, and steps of an iteration.
    sizes: [usize; 2],
    /// Steps a second of all environments, updates included.
    steps: f64,
    /// Shares of the time: rollout, update.
    shares: [f64; 2],
    /// Memory of the card that it took (GiB).
    memory: f64,
}

/// In the model of the task's robot, and in four implicit substeps.
pub(super) fn both(task: &str, environments: usize, seed: u64) -> Result<[Learning; 2]> {
    let folder = shipped::model_of_task(task, nerd_tasks::named(task)?.robot());
    let learned = measure(task, &Arena::Model { folder, device: Device::Cuda }, environments, seed)?;
    Ok([learned, measure(task, &Arena::Card(Setting::Implicit(4)), environments, seed)?])
}

/// Trains for a few iterations at the paper's settings but for the number of environments.
fn measure(task: &str, arena: &Arena, environments: usize, seed: u64) -> Result<Learning> {
    let config = PpoConfig { environments, ..PpoConfig::of(task)? };
    let had = nerd_cuda::Device::free()?;
    let mut trainer = arena.trainer(nerd_tasks::named(task)?, config.clone(), seed, &Arc::default())?;
    // Kernels are compiled and memory taken once.
    (0..2).try_for_each(|_| trainer.iterate().map(drop))?;
    let (began, mut rollout, mut update) = (Instant::now(), 0.0, 0.0);
    for _ in 0..ITERATIONS {
        let line = trainer.iterate()?;
        rollout += line.rollout_seconds;
        update += line.update_seconds;
    }
    let all = began.elapsed().as_secs_f64();
    let memory = (had as f64 - nerd_cuda::Device::free()? as f64) / f64::from(1 << 30);
    let shares = [rollout, update].map(|seconds| seconds / all);
    let (sizes, steps) = ([environments, config.steps()], (ITERATIONS * config.steps()) as f64 / all);
    Ok(Learning { task: task.into(), solver: arena.title()?, sizes, steps, shares, memory })
}

pub(super) fn table(rows: &[Learning]) -> Table {
    let header = ["task", "solver", "environments", "steps an iteration", "steps/s", "rollout (%)", "update (%)", "memory (GiB)"];
    let lines = rows.iter().map(|row| {
        let [environments, steps] = row.sizes.map(|n| n.to_string());
        let shares = row.shares.map(|share| format!("{:.0}", 100.0 * share));
        let head = [row.task.clone(), row.solver.clone(), environments, steps, digits(row.steps)];
        head.into_iter().chain(shares).chain([format!("{:.1}", row.memory)]).collect()
    });
    let note = "PPO in the shipped model of the task's robot, and in the analytic solver, updates included: frames, tasks, the policy's answers \
                and its updates are all on the card. The paper's settings but for the number of \
                environments.";
    Table::new("learning", &header).with(lines).noted(note)
}
