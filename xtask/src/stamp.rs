//! `cargo xtask stamp models`: writes into the `config.json` of every model below a folder the hash of its robot and of all that
//! decides its predictions, which loading holds it to.
//!
//! Training does so by itself. This is for models from before, and for those whose robot was changed in a way that leaves what
//! they learned true: who stamps a model says that it fits.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use nerd_model::folder::{ModelConfig, models_in, stamp};
use nerd_sim::prelude::*;

/// Stamp models with the hashes of their robot and of what they compute.
#[derive(clap::Args, Clone, Debug)]
pub struct StampArgs {
    /// Folders of models, or folders with models below them
    #[arg(required = true)]
    pub folders: Vec<PathBuf>,
    /// Path of the robot's .urdf, if it is not built in
    #[arg(long)]
    pub robot: Option<String>,
}

/// Runs the verb.
pub fn run(args: StampArgs) -> Result<()> {
    let models: Vec<PathBuf> = args.folders.iter().map(|f| models_in(f)).collect::<Result<Vec<_>, _>>()?.concat();
    if models.is_empty() {
        bail!("no model in {}", args.folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", "));
    }
    for folder in models {
        let robot = args.robot.clone().map_or_else(|| ModelConfig::read(&folder).map(|config| config.robot), Ok)?;
        let system = System::named(&robot).with_context(|| format!("{}: name its robot with --robot", folder.display()))?;
        let changes = stamp(&folder, &system)?;
        println!("{}: {}", folder.display(), if changes.is_empty() { "as it was".into() } else { changes.join(", ") });
    }
    Ok(())
}
