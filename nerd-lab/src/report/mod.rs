//! Results of experiments: provenance, inputs, tables, figures, and their use in documents.

pub mod artifact;
mod draw;
mod figure;
mod inputs;
pub mod manifest;
pub mod marks;

use std::io;

use crate::{error, prelude::*};

pub use artifact::{Artifact, Table, or_dash};
pub use figure::{Axis, Figure, Mark, Panel, Series, Style, unbeaten};
pub use inputs::{Input, Inputs};
pub use manifest::{Manifest, Status};
pub use nerd_train::provenance::Provenance;
pub use nerd_train::words::{digits, pair};

/// Writes a file atomically.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).map_err(error::file(path))
}

pub fn write_json(path: &Path, what: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(what).map_err(error::file(path))?;
    write(path, (text + "\n").as_bytes())
}

pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = nerd_sim::files::read_text(path).map_err(error::file(path))?;
    serde_json::from_str(&text).map_err(error::file(path))
}

/// Names of the files and folders in a folder; empty if the folder cannot be read.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

/// All files below a folder, sorted; links are not followed. Empty if the folder is missing.
pub fn below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    if !folder.exists() {
        return Ok(found);
    }
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => found.extend(below(&entry.path())?),
            false => found.push(entry.path()),
        }
    }
    found.sort();
    Ok(found)
}
