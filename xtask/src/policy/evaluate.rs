//! `cargo xtask policy evaluate --policy models/policies/cartpole-swingup-neural-0`: the paper's protocol, 2048 games under mean
//! actions, in the truth and in the simulator that learned it.

use std::path::{Path, PathBuf};

use anyhow::Result;
use nerd_train::experiments::policies::Policies;
use nerd_train::experiments::{Experiment, conduct};

use crate::common::{DEVICES, Device, word};
use crate::numbers::{SEEDS, STARTS, count};

/// Play a policy in the truth and in the learned simulator.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    /// Folder of the policy
    #[arg(long)]
    pub policy: PathBuf,
    /// Folder of the learned simulator's model [default: models/ROBOT]; the truth is the one it learned
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Play in the truth alone
    #[arg(long)]
    pub truth_only: bool,
    /// Games (the paper: 2048)
    #[arg(long, default_value_t = 2048, value_parser = count::<usize>(STARTS))]
    pub games: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Where the learned simulator is computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// JSON file to write, and its tables beside it
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    let EvaluateArgs { policy, model, truth_only, games, seed, device, out } = args;
    let stem = |path: &Path| path.file_stem().map_or_else(|| "policy".into(), |s| s.to_string_lossy().into_owned());
    let name = out.as_deref().map(stem).unwrap_or_default();
    let experiment = Policies { name, folders: vec![policy], model, truth_only, games, seed, device };
    let tables = match &out {
        Some(path) => conduct(&experiment, path.parent().unwrap_or(Path::new("")))?.tables,
        None => experiment.tables(&experiment.measure()?)?,
    };
    crate::out::tables(&tables);
    Ok(())
}
