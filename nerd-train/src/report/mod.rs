//! Where figures come from and where they go: provenance, what was measured, tables, pictures, files.

pub mod artifact;
#[cfg(feature = "report")]
mod axis;
#[cfg(feature = "report")]
pub mod film;
#[cfg(feature = "report")]
pub mod frames;
#[cfg(feature = "report")]
pub mod heat;
pub mod inputs;
pub mod manifest;
pub mod marks;
pub mod motions;
#[cfg(feature = "report")]
pub mod page;
#[cfg(feature = "report")]
mod pixels;
#[cfg(feature = "report")]
pub mod plot;
pub mod provenance;
pub mod replay;
#[cfg(feature = "report")]
pub mod scene;
mod solids;
pub mod table;

use std::path::Path;

pub use artifact::Artifact;
pub use inputs::{Input, Inputs};
pub use manifest::{Manifest, Status};
pub use provenance::Provenance;
pub use table::Table;

use crate::error::{Error, Result};

/// Writes a file, whole or not at all.
///
/// # Errors
/// What the file system says, with the file's name.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).map_err(Error::file(path))
}
