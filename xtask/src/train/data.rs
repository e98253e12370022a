//! What is recorded for a run, and who acts in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, bail};
use nerd_model::form::Form;
use nerd_sim::dataset::{GenerateConfig, Pilot};
use nerd_sim::law::Law;
use nerd_sim::prelude::*;
use nerd_train::ppo::Policies;
use nerd_train::prepare::{Prepared, generate};

use super::TrainArgs;

/// What a run records.
pub fn recording(args: &TrainArgs, transitions: usize, seed: u64) -> GenerateConfig {
    let torque_scale = Law { low: args.torque_scale, high: 1.0 };
    // Small shards come soon, whatever the truth.
    let shard_trajectories = if args.fresh > 0 { 64 } else { 512 };
    let TrainArgs { frames, hold, resets, .. } = *args;
    GenerateConfig { transitions, seed, torque_scale, shard_trajectories, frames, hold, resets, pilot: None }
}

/// The policies that act in part of the data.
pub fn pilot(args: &TrainArgs, system: &System) -> Result<Option<(Arc<dyn Pilot>, f64)>> {
    if args.policy.is_empty() {
        return Ok(None);
    }
    if args.data.is_some() {
        bail!("--policy records by itself: leave out --data");
    }
    let mut policies = Vec::new();
    for folder in &args.policy {
        let (config, policy) = nerd_train::ppo::folder::load(folder)?;
        let robot = nerd_tasks::named(&config.task)?.robot();
        if robot != system.name {
            bail!("{} acts on `{robot}`, not on `{}`", folder.display(), system.name);
        }
        policies.push((config.task, policy));
    }
    Ok(Some((Arc::new(Policies::new(policies)?), args.policy_share)))
}

/// Records it in memory.
pub fn recorded(system: &Arc<System>, args: &TrainArgs, config: &GenerateConfig, history: usize, form: Form) -> Result<Prepared> {
    let bar = crate::common::bar("recording transitions", (config.trajectories() * config.frames) as u64);
    let done = AtomicUsize::new(0);
    let tell = |n: usize| bar.set((done.fetch_add(n, Ordering::Relaxed) + n) as u64);
    let prepared = generate(system, &|| args.truth.solver(system), config, history, form, &tell)?;
    bar.finish();
    Ok(prepared)
}
