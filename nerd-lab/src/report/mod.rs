//! The results that the repository keeps, and their use in its documents.

pub mod manifest;
pub mod marks;

use std::io;

use crate::prelude::*;

pub use manifest::{Manifest, Status};

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
