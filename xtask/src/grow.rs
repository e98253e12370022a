//! `cargo xtask grow`: what a frame costs as a robot grows ([`nerd_lab::experiments::grow`]). Minutes on one core.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::experiments::grow::Grow;
use nerd_train::shipped::results;

use crate::numbers::{FRAMES, SEEDS, STARTS, count, positive};

/// Links of an arm: its mass matrix is dense.
const LINKS: RangeInclusive<u64> = 1..=256;

/// Time a frame of arms of more and more links.
#[derive(clap::Args, Clone, Debug)]
pub struct GrowArgs {
    /// Numbers of links, comma-separated
    #[arg(long, value_delimiter = ',', default_value = "4,8,16,32,64", value_parser = count::<usize>(LINKS))]
    pub links: Vec<usize>,
    /// Trajectories
    #[arg(long, default_value_t = 16, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames
    #[arg(long, default_value_t = 30, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
    /// Errors (mean |dq|, rad) that an analytic solver is asked for, comma-separated
    #[arg(long, value_delimiter = ',', default_value = "0.03,0.01", value_parser = positive)]
    pub tolerance: Vec<f64>,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder for grow.json, .md, .svg and .png [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: GrowArgs) -> Result<()> {
    let GrowArgs { links, starts, frames, tolerance, seed, out } = args;
    crate::out::conduct(&Grow { links, starts, horizon: frames, tolerances: tolerance, seed }, &out.unwrap_or_else(results))
}
