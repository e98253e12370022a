//! Rewrites a model's hashes: whoever does so claims that it fits its robot.

use std::path::{Path, PathBuf};

use nerd_sim::files::read_text;
use nerd_sim::system::System;

use super::error::{file, wrong};
use super::{Model, ModelConfig, ModelError};

/// Folders of models: this one and those below it that have a network, in order; a policy's folder has none.
///
/// # Errors
/// If a folder or a `config.json` cannot be read.
pub fn models_in(folder: &Path) -> Result<Vec<PathBuf>, ModelError> {
    let mut models = Vec::new();
    let path = folder.join("config.json");
    if path.exists() {
        let text = read_text(&path).map_err(file(&path))?;
        let config: serde_json::Value = serde_json::from_str(&text).map_err(|e| wrong(&path, e.to_string()))?;
        models.extend(config.get("network").map(|_| folder.into()));
    }
    for entry in std::fs::read_dir(folder).map_err(file(folder))? {
        let entry = entry.map_err(file(folder))?;
        // Links may lead in circles.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            models.extend(models_in(&entry.path())?);
        }
    }
    models.sort();
    Ok(models)
}

/// Writes into a model's `config.json` the hashes of this robot and of what the folder computes; what has changed, in words.
///
/// # Errors
/// If it cannot be read, cannot be of this robot, or cannot be written.
pub fn stamp(folder: &Path, system: &System) -> Result<Vec<String>, ModelError> {
    let before = ModelConfig::read(folder)?;
    let mut model = Model::read(folder, system, None)?;
    model.stamp(system);
    let hashes = [
        ("robot", &before.robot_sha256, &model.config.robot_sha256),
        ("network, normaliser and weights", &before.model_sha256, &model.config.model_sha256),
    ];
    let changes = hashes.into_iter().filter(|(_, before, now)| before != now);
    let words = |(what, before, now): (&str, &String, &String)| {
        format!("{what} {} -> {}", before.get(..12).unwrap_or("not known"), now.get(..12).unwrap_or(now))
    };
    let changes: Vec<String> = changes.map(words).collect();
    if !changes.is_empty() {
        let path = folder.join("config.json");
        let text = serde_json::to_string_pretty(&model.config).map_err(|e| wrong(&path, e.to_string()))?;
        nerd_sim::files::write(&path, (text + "\n").as_bytes()).map_err(file(&path))?;
    }
    Ok(changes)
}
