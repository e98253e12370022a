//! Where figures come from and where they go: provenance, what was measured, tables, pictures, documents.

pub mod artifact;
pub mod figure;
pub mod inputs;
pub mod manifest;
pub mod marks;
pub mod table;

use std::path::Path;

use crate::error::{self, Result};

pub use artifact::Artifact;
pub use inputs::{Input, Inputs};
pub use manifest::{Manifest, Status};
pub use nerd_train::provenance::Provenance;
pub use table::Table;

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).map_err(error::file(path))
}
