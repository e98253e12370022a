//! [`nerd_sim::files`] with an error that names the file; replays as pages.

use std::path::Path;

use anyhow::{Context, Result};
use nerd_train::replay::Replay;

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a replay as a page.
pub fn replay(path: &Path, replay: &Replay) -> Result<()> {
    write(path, replay.html().as_bytes())?;
    tell!("replay written to {}", path.display());
    Ok(())
}
