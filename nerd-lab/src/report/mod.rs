//! Where figures come from and where they go: provenance, what was measured, tables, pictures, documents, the page.

pub mod artifact;
pub mod figure;
pub mod film;
pub mod game;
pub mod inputs;
pub mod manifest;
pub mod marks;
pub mod motions;
pub mod page;
pub mod replay;
mod solids;
pub mod table;

use std::path::Path;

pub use artifact::Artifact;
pub use inputs::{Input, Inputs};
pub use manifest::{Manifest, Status};
pub use nerd_train::provenance::Provenance;
pub use table::Table;

use crate::error;
use crate::error::Result;

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(nerd_sim::files::write(path, bytes).map_err(error::file(path))?)
}
