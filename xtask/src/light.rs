//! `cargo xtask light FOLDER`: models with f32 weights become models in half the bytes, and what that costs is measured.

use std::path::PathBuf;

use anyhow::Result;
use nerd_train::experiments::storage::{Rounding, Roundings};
use nerd_train::shipped;

use crate::numbers::{STARTS, count};
use crate::out::conduct;

/// Store hidden matrices as f16, and measure what that costs.
#[derive(clap::Args, Clone, Debug)]
pub struct LightArgs {
    /// Folder with folders of models whose weights are f32: cartpole, franka, pendulum-paper
    pub parents: PathBuf,
    /// Rollouts
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Folder that the light models are written to, each into one of its own; nothing is written without
    #[arg(long)]
    pub models: Option<PathBuf>,
    /// Folder of the result [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: LightArgs) -> Result<()> {
    let experiment = Roundings::shipped(args.parents, args.starts);
    if let Some(models) = &args.models {
        experiment.subjects.iter().try_for_each(|s| experiment.write(s, Rounding::Compensated, &models.join(&s.folder)))?;
    }
    conduct(&experiment, &args.out.unwrap_or_else(shipped::results))
}
