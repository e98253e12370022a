//! `cargo xtask stamp models`: writes into the `config.json` of every model below a folder the hash of its robot and of all that
//! decides its predictions, which loading holds it to.
//!
//! Training does so by itself. This is for models from before, and for those whose robot was changed in a way that leaves what
//! they learned true: who stamps a model says that it fits.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nerd_model::folder::{Model, ModelConfig};
use nerd_sim::files::read_text;
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
    let mut models = Vec::new();
    args.folders.iter().try_for_each(|folder| find(folder, &mut models))?;
    if models.is_empty() {
        bail!("no model in {}", args.folders.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", "));
    }
    models.sort();
    models.iter().try_for_each(|folder| stamp(folder, args.robot.as_deref()))
}

/// Models in a folder and below: those with a network; a policy's folder has none.
fn find(folder: &Path, models: &mut Vec<PathBuf>) -> Result<()> {
    let path = folder.join("config.json");
    if path.exists() {
        let text = read_text(&path).with_context(|| path.display().to_string())?;
        let config: serde_json::Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        if config.get("network").is_some() {
            models.push(folder.into());
        }
    }
    let entries = std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    for entry in entries {
        let entry = entry.with_context(|| format!("cannot read {}", folder.display()))?;
        // Links may lead in circles.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            find(&entry.path(), models)?;
        }
    }
    Ok(())
}

fn stamp(folder: &Path, robot: Option<&str>) -> Result<()> {
    let before = ModelConfig::read(folder)?;
    let system =
        System::named(robot.unwrap_or(&before.robot)).with_context(|| format!("{}: name its robot with --robot", folder.display()))?;
    let mut model = Model::read(folder, &system, None)?;
    model.stamp(&system);
    let changes: Vec<String> = [
        ("robot", &before.robot_sha256, &model.config.robot_sha256),
        ("network, normaliser and weights", &before.model_sha256, &model.config.model_sha256),
    ]
    .into_iter()
    .filter(|(_, before, now)| before != now)
    .map(|(what, before, now)| format!("{what} {} -> {}", before.get(..12).unwrap_or("not known"), &now[..12]))
    .collect();
    if changes.is_empty() {
        println!("{}: as it was", folder.display());
        return Ok(());
    }
    crate::files::write(&folder.join("config.json"), (serde_json::to_string_pretty(&model.config)? + "\n").as_bytes())?;
    println!("{}: {}", folder.display(), changes.join(", "));
    Ok(())
}
