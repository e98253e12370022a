//! `cargo xtask tosses --data FOLDER`: real tosses of a cube, predicted open loop; see [`nerd_train::experiments::tosses`].
//! Some minutes on two cores.

use std::path::PathBuf;

use anyhow::Result;
use nerd_train::experiments::tosses::Tosses;
use nerd_train::shipped::results;

use crate::numbers::{FRAMES, SEEDS, count};
use crate::out::conduct;

/// Predict real tosses of a cube.
#[derive(clap::Args, Clone, Debug)]
pub struct TossesArgs {
    /// Folder with tosses.csv and tosses_meta.csv
    #[arg(long)]
    pub data: PathBuf,
    /// A window begins at every so many samples of a toss
    #[arg(long, default_value_t = 4, value_parser = count::<usize>(FRAMES))]
    pub every: usize,
    /// Seed of the noise that is put on velocities
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder for tosses.json, .md, .svg and .png [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: TossesArgs) -> Result<()> {
    conduct(&Tosses::new(&args.data, args.every, args.seed)?, &args.out.unwrap_or_else(results))
}
