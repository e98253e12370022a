//! `cargo xtask stability`: where each method passes, degrades and fails. Failures are the point.

use nerd_lab::experiments::stability::Stability;

use crate::{options::DEVICES, out::conduct, prelude::*};

#[derive(clap::Args, Clone, Debug)]
pub struct StabilityArgs {
    /// Words, comma-separated, that select rows: those whose names contain one of them [default: all rows]
    #[arg(long, value_name = "WORDS", value_delimiter = ',')]
    pub rows: Vec<String>,
    /// Device: cpu (all methods), or cuda (`articulated` on a GPU beside the CPU, written as stability-device)
    /// [default: cpu]
    #[arg(long, value_parser = word::<Device>(DEVICES))]
    pub device: Option<Device>,
    /// Python that has MuJoCo. Runs the rows in MuJoCo beside rapier and `articulated`, written as stability-mujoco
    #[arg(long, value_name = "PYTHON", conflicts_with = "device")]
    pub mujoco: Option<PathBuf>,
    /// Folder to write the result into [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

pub fn run(args: StabilityArgs) -> Result<()> {
    let out = args.out.unwrap_or_else(nerd_train::shipped::results);
    if args.device == Some(Device::Cuda) {
        #[cfg(feature = "cuda")]
        return conduct(&Stability::on_device(&args.rows)?, &out).map(drop);
        #[cfg(not(feature = "cuda"))]
        anyhow::bail!("--device cuda needs a build with `--features cuda`");
    }
    if let Some(python) = args.mujoco {
        return conduct(&Stability::beside_mujoco(&args.rows, &python)?, &out).map(drop);
    }
    conduct(&Stability::new(&args.rows)?, &out).map(drop)
}
