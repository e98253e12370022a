//! Files: output that is there whole or not at all, folders that one process at a time writes, texts.

mod lock;

use std::fs::OpenOptions;
use std::io::{Error, Result, Write};
use std::path::{Path, PathBuf};

pub use lock::{Claim, claim};

/// What is wrong with a file; one line.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// Why it cannot be used, with its line if it has one.
    pub reason: String,
}

impl FileError {
    /// What is wrong with this file.
    pub fn new(path: &Path, reason: impl ToString) -> Self {
        Self { path: path.into(), reason: reason.to_string() }
    }
}

/// Replaces the file at `path` (its folder is made if absent) by `bytes`; see [`write_with`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// Replaces the file at `path` by what `fill` writes, under a temporary name first, so a reader of `path` sees an old or
/// a new file, never half of one. A symbolic link stays, and what it leads to is replaced; a device or a pipe is written
/// into. What writers that were killed left in the folder is removed. After an error an older file at `path` is untouched.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let path = &target(path)?;
    match std::fs::metadata(path) {
        Ok(there) if there.is_dir() => return Err(Error::new(std::io::ErrorKind::IsADirectory, "is a folder, not a file")),
        Ok(there) if !there.is_file() => {
            let mut device = OpenOptions::new().write(true).open(path)?;
            return fill(&mut device).and_then(|()| device.flush());
        }
        _ => {}
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    lock::sweep(folder);
    let mut file = lock::create(folder)?;
    fill(&mut file)?;
    // On the disk before the rename is: otherwise a power cut may leave the new name with no content.
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Refuses what is no file: it may never end, as a device or a pipe that nobody writes to.
pub fn is_file(path: &Path) -> Result<()> {
    let refused = |kind, said| Err(Error::new(kind, said));
    match std::fs::metadata(path)? {
        there if there.is_dir() => refused(std::io::ErrorKind::IsADirectory, "is a folder, not a file"),
        there if !there.is_file() => refused(std::io::ErrorKind::InvalidInput, "is a pipe or a device; save what it holds as a file"),
        _ => Ok(()),
    }
}

/// The bytes of a file.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    is_file(path)?;
    std::fs::read(path)
}

/// A text file; says where it is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read(path)?).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let line = 1 + e.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
        Error::new(std::io::ErrorKind::InvalidData, format!("not UTF-8 at byte {at}, line {line}; save it as UTF-8"))
    })
}

/// Where a chain of symbolic links ends, whether there is something or not.
fn target(path: &Path) -> Result<PathBuf> {
    let mut path = path.to_path_buf();
    // As many as Linux follows.
    for _ in 0..40 {
        // What the links of /proc/self/fd lead to has no name in the file system, but can be opened.
        let special = std::fs::metadata(&path).is_ok_and(|there| !there.is_file() && !there.is_dir());
        match std::fs::read_link(&path) {
            Ok(next) if !special => path = path.parent().unwrap_or(Path::new("")).join(next),
            _ => return Ok(path),
        }
    }
    Err(Error::other("too many symbolic links"))
}
