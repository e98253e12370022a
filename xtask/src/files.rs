//! [`nerd_sim::files`] with an error that names the file; replays as what the file's ending asks for.

use std::path::Path;

use anyhow::{Context, Result};
use nerd_lab::report::replay::Replay;
use nerd_lab::report::{Provenance, film};

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    nerd_sim::files::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes a replay: of FILE.svg a still picture, with FILE.png beside it, else a page.
pub fn replay(path: &Path, replay: &Replay, seed: u64) -> Result<()> {
    match path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")) {
        true => film::still(replay, &Provenance::now(seed).to_string().replace('`', ""), path)?,
        false => write(path, replay.html().as_bytes())?,
    }
    eprintln!("replay written to {}", path.display());
    Ok(())
}
