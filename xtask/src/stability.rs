//! `cargo xtask stability`: shows where each method passes, degrades and fails. Some methods are expected to fail.

use nerd_cli::{options::DEVICES, out::conduct};
use nerd_lab::experiments::stability::Stability;

use crate::prelude::*;

#[derive(clap::Args)]
pub struct StabilityArgs {
    /// Words, comma-separated, that select rows: those whose names contain one of them [default: all rows]
    #[arg(long, value_name = "WORDS", value_delimiter = ',')]
    pub rows: Vec<String>,
    /// Device: cpu (all methods), or cuda (`articulated` on a GPU beside the CPU, written as stability-device)
    /// [default: cpu]
    #[arg(long, value_parser = word::<Device>(DEVICES))]
    pub device: Option<Device>,
    /// Python that has MuJoCo. Runs the rows in MuJoCo beside rapier and `articulated`, written as stability-mujoco
    #[arg(long, conflicts_with = "device")]
    pub mujoco: Option<PathBuf>,
    /// Folder to write the result into [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

pub fn run(args: StabilityArgs) -> Result<()> {
    let out = args.out.unwrap_or_else(results);
    let stability = match args.mujoco {
        Some(python) => Stability::beside_mujoco(&args.rows, &python),
        None if args.device == Some(Device::Cuda) => Stability::on_device(&args.rows),
        None => Stability::new(&args.rows),
    };
    conduct(&stability?, &out).map(drop)
}
