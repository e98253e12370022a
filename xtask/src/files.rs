//! [`nerd_sim::files`] with an error that names the file.

use std::path::Path;

use anyhow::{Context, Result};

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}
