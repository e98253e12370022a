//! Folders of the project's own files: models, policies, results.

use crate::prelude::*;

/// The workspace around the current folder, as a path from there: empty where it is the current folder itself, or where there
/// is none around.
pub fn root() -> PathBuf {
    let Ok(here) = std::env::current_dir() else { return PathBuf::new() };
    let whole = |folder: &&Path| std::fs::read_to_string(folder.join("Cargo.toml")).is_ok_and(|text| text.contains("[workspace]"));
    match here.ancestors().find(whole) {
        Some(found) if found != here => found.into(),
        _ => PathBuf::new(),
    }
}

/// A path without the workspace's own, as artefacts have it; of one elsewhere the last two parts, since other machines have other folders.
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

/// Folder of the models that come with the project.
pub fn models() -> PathBuf {
    root().join("models")
}

/// Folder of the model of a robot that comes with the project: `models/ROBOT`, of rapier `models/ROBOT-rapier`.
pub fn model(truth: Truth, robot: &str) -> PathBuf {
    models().join(match truth {
        Truth::Articulated | Truth::Paper => robot.to_string(),
        Truth::Rapier => format!("{robot}-rapier"),
        _ => format!("{robot}-{}", truth.name()),
    })
}

/// Folder of the model that comes with the project for a task: `models/TASK` if there is one, trained on along its policies' motions, or
/// else its robot's.
pub fn model_of_task(task: &str, robot: &str) -> PathBuf {
    let own = models().join(task);
    if own.join("config.json").exists() { own } else { model(Truth::default(), robot) }
}

/// Folders of models or policies in one, by how their names begin, in order; none if it is not there.
pub fn folders(of: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    if !of.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(of).map_err(Error::file(of))?;
    let named = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix));
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| named(p) && p.join("config.json").exists()).collect();
    found.sort();
    Ok(found)
}

/// Folders of the policies that come with the project, by how their names begin.
pub fn policies(prefix: &str) -> Result<Vec<PathBuf>> {
    folders(&root().join("models/policies"), prefix)
}

/// Folder of the project's results.
pub fn results() -> PathBuf {
    root().join("results")
}

/// A path as it is given, or if there is nothing, from the workspace's root.
pub fn find(path: &Path) -> PathBuf {
    let other = root().join(path);
    if !path.exists() && other.exists() { other } else { path.into() }
}
