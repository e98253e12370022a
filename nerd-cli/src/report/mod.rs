//! Results of experiments: provenance, inputs, tables, figures.

pub mod artifact;
mod draw;
mod figure;
mod inputs;

use crate::{error, prelude::*};

pub use artifact::{Artifact, Table, file, or_dash};
pub use figure::{Axis, Figure, Mark, Panel, Series, Style, unbeaten};
pub use inputs::{Input, Inputs};
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
