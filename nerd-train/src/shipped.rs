//! Paths of the project's own files: models, policies, results.

use crate::prelude::*;

/// Root of the workspace that contains the current folder. Empty if the current folder is the root, or if there is no
/// workspace.
pub fn root() -> PathBuf {
    let Ok(here) = std::env::current_dir() else { return PathBuf::new() };
    let whole = |folder: &&Path| {
        std::fs::read_to_string(folder.join("Cargo.toml")).is_ok_and(|text| text.contains("[workspace]"))
    };
    match here.ancestors().find(whole) {
        Some(found) if found != here => found.into(),
        _ => PathBuf::new(),
    }
}

/// A path relative to the workspace's root, as written into artefacts. Of an absolute path outside the workspace, only
/// the last two parts are kept, since other machines have other folders.
///
/// ```
/// assert_eq!(nerd_train::shipped::from_root("/somewhere/else/ant/model".as_ref()), "ant/model");
/// ```
pub fn from_root(path: &Path) -> String {
    let elsewhere = || {
        let skipped = if path.is_absolute() { path.components().count().saturating_sub(2).max(1) } else { 0 };
        path.components().skip(skipped).collect()
    };
    path.strip_prefix(root()).map_or_else(|_| elsewhere(), Path::to_path_buf).display().to_string()
}

/// Folder of the shipped models.
pub fn models() -> PathBuf {
    root().join("models")
}

/// Folder of the shipped model of a robot: `models/ROBOT`; for rapier as truth, `models/ROBOT-rapier`.
pub fn model(truth: Truth, robot: &str) -> PathBuf {
    models().join(match truth {
        Truth::Articulated | Truth::Paper => robot.to_string(),
        Truth::Rapier => format!("{robot}-rapier"),
        _ => format!("{robot}-{}", truth.name()),
    })
}

/// Folder of the shipped model for a task: `models/TASK`, fine-tuned on motions of its policies, if it exists; else the
/// robot's model.
pub fn model_of_task(task: &str, robot: &str) -> PathBuf {
    let own = models().join(task);
    if own.join("config.json").exists() { own } else { model(Truth::default(), robot) }
}

/// Model or policy folders in `of` with names that begin with `prefix`, sorted; none if `of` does not exist.
pub fn folders(of: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    if !of.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(of).map_err(Error::file(of))?;
    let named = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix));
    let mut found =
        entries.flatten().map(|e| e.path()).filter(|p| named(p) && p.join("config.json").exists()).collect_vec();
    found.sort();
    Ok(found)
}

/// Folders of the shipped policies with names that begin with `prefix`.
pub fn policies(prefix: &str) -> Result<Vec<PathBuf>> {
    folders(&root().join("models/policies"), prefix)
}

/// Folder of the project's results.
pub fn results() -> PathBuf {
    root().join("results")
}

/// The path if it exists, else the path from the workspace's root if that exists.
pub fn find(path: &Path) -> PathBuf {
    let other = root().join(path);
    if !path.exists() && other.exists() { other } else { path.into() }
}
