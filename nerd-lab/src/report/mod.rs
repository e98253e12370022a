//! Where figures come from and where they go: provenance, what was measured, tables, pictures, files.

pub mod artifact;
mod axis;
pub mod curve;
pub mod film;
pub mod frames;
pub mod game;
pub mod heat;
pub mod inputs;
pub mod manifest;
pub mod marks;
pub mod motions;
pub mod page;
mod pixels;
pub mod plot;
pub mod replay;
pub mod scene;
mod solids;
pub mod table;

use std::path::Path;

pub use artifact::Artifact;
pub use inputs::{Input, Inputs};
pub use manifest::{Manifest, Status};
pub use nerd_train::provenance::Provenance;
pub use table::Table;

use crate::error::Result;

/// Writes a file, whole or not at all.
///
/// # Errors
/// What the file system says, with the file's name.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(nerd_sim::files::write(path, bytes).map_err(crate::error::file(path))?)
}
