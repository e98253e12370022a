//! `cargo xtask reproduce horizons`: how the errors of models grow over 1000 frames ([`nerd_lab::experiments::horizons`]).

use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::experiments::horizons::Horizons;
use nerd_train::shipped::results;

use crate::common::{DEVICES, Device, word};
use crate::numbers::{FRAMES, SEEDS, STARTS, count};

/// Draw error against time of learned models.
#[derive(clap::Args, Clone, Debug)]
pub struct HorizonArgs {
    /// Folders of models, comma-separated [default: one for each robot, of those that come with the project]
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Rollouts
    #[arg(long, default_value_t = 128, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames
    #[arg(long, default_value_t = 1000, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Where networks are computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Folder for horizons.json, .md and a picture of each model [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the part.
pub fn run(args: HorizonArgs) -> Result<()> {
    let HorizonArgs { model, starts, frames, seed, device, out } = args;
    let models = if model.is_empty() { Horizons::default().models } else { model };
    crate::out::conduct(&Horizons { models, starts, steps: frames, seed, device }, &out.unwrap_or_else(results))
}
