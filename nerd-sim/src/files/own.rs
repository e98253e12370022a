//! Protects existing files: files written by this program may be replaced, others not.

use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Refuses to replace an existing file unless `ours` recognises its bytes. An empty file may be replaced.
pub fn replaceable(path: &Path, ours: impl FnOnce(&[u8]) -> bool) -> Result<()> {
    if !path.is_file() {
        return Ok(());
    }
    let bytes = super::read(path)?;
    if bytes.is_empty() || ours(&bytes) { Ok(()) } else { Err(foreign(path)) }
}

/// Refuses a folder with an entry of one of these names, unless `ours` recognises the folder.
pub fn unclaimed(folder: &Path, names: &[&str], ours: impl FnOnce() -> bool) -> Result<()> {
    match names.iter().find(|name| folder.join(name).symlink_metadata().is_ok()) {
        Some(name) if !ours() => Err(foreign(&folder.join(name))),
        _ => Ok(()),
    }
}

fn foreign(path: &Path) -> Error {
    let text = format!(
        "{} is there, and was not written by this command: it would be replaced; move it away, or write elsewhere",
        path.display()
    );
    Error::new(ErrorKind::AlreadyExists, text)
}

/// Whether a file is JSON with all these keys.
pub fn has_keys(path: &Path, keys: &[&str]) -> bool {
    let object = || serde_json::from_slice::<serde_json::Value>(&super::read(path).ok()?).ok();
    object().is_some_and(|object| keys.iter().all(|key| object.get(key).is_some()))
}
