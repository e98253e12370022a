//! Files: output written whole or not at all, folders with one writer at a time, text.

mod lock;
pub mod memory;
mod own;
pub mod renamed;
mod xml;

use std::fs::{File, OpenOptions};
use std::io::{Error, Read, Result, Write};
use std::path::{Path, PathBuf};

pub use lock::{Claim, claim};
pub use own::{has_keys, replaceable, unclaimed};
pub(crate) use xml::nested;

/// An error about a file; one line.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// Reason, with the line number if there is one.
    pub reason: String,
}

impl FileError {
    /// An error about the file at `path`.
    pub fn new(path: &Path, reason: impl ToString) -> Self {
        Self { path: path.into(), reason: reason.to_string() }
    }
}

/// Replaces the file at `path` by `bytes`, and creates its folder if absent; see [`write_with`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// Replaces the file at `path` by the output of `fill`, through a temporary file and a rename. A reader of `path` sees
/// the old or the new file, never a part. A symbolic link stays and its target is replaced; a device or pipe is written
/// to directly. Temporary files of killed writers in the folder are removed. After an error, the old file is untouched.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let path = &target(path)?;
    match std::fs::metadata(path) {
        Ok(there) if there.is_dir() => {
            return Err(Error::new(std::io::ErrorKind::IsADirectory, "is a folder, not a file"));
        }
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
    // Flush to disk before the rename: otherwise a power cut may leave the new name without content.
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Refuses anything but a regular file: reading a device, or a pipe without a writer, may never end.
pub fn is_file(path: &Path) -> Result<()> {
    let refused = |kind, said| Err(Error::new(kind, said));
    match std::fs::metadata(path)? {
        there if there.is_dir() => refused(std::io::ErrorKind::IsADirectory, "is a folder, not a file"),
        there if !there.is_file() => {
            refused(std::io::ErrorKind::InvalidInput, "is a pipe or a device; save what it holds as a file")
        }
        _ => Ok(()),
    }
}

/// Largest text file (bytes).
pub const LARGEST_TEXT: u64 = 1 << 26;
/// Largest file of tables or arrays (bytes).
pub const LARGEST_TABLE: u64 = 1 << 31;

/// Reads a file, if it fits into free memory.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    read_most(path, memory::free())
}

/// Reads a file of at most `most` bytes.
pub fn read_most(path: &Path, most: u64) -> Result<Vec<u8>> {
    bounded(path, most)?;
    let mut bytes = Vec::new();
    // The file may grow while it is read.
    File::open(path)?.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Refuses a file of more than `most` bytes.
pub fn bounded(path: &Path, most: u64) -> Result<()> {
    is_file(path)?;
    let size = std::fs::metadata(path)?.len();
    match size > most {
        true => Err(Error::new(std::io::ErrorKind::FileTooLarge, too_large(size, most))),
        false => Ok(()),
    }
}

/// A hash in hexadecimal digits.
pub fn hex(hash: impl AsRef<[u8]>) -> String {
    hash.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The error message of a file that is too large, in megabytes.
pub(crate) fn too_large(size: u64, most: u64) -> String {
    format!("has {} MB; at most {} MB are read", size >> 20, most >> 20)
}

/// Reads a text file; an error names the first position that is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    text(read_most(path, LARGEST_TEXT)?)
}

/// Reads a text file that grows with a run, such as its metrics: limited by free memory only.
pub fn read_record(path: &Path) -> Result<String> {
    text(read(path)?)
}

fn text(bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let line = 1 + e.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
        Error::new(std::io::ErrorKind::InvalidData, format!("not UTF-8 at byte {at}, line {line}; save it as UTF-8"))
    })
}

/// The end of a chain of symbolic links, whether or not it exists.
fn target(path: &Path) -> Result<PathBuf> {
    let mut path = path.to_path_buf();
    // Linux follows at most 40 symbolic links.
    for _ in 0..40 {
        // Links in /proc/self/fd may lead to targets without a name in the file system, which can still be opened.
        let special = std::fs::metadata(&path).is_ok_and(|there| !there.is_file() && !there.is_dir());
        match std::fs::read_link(&path) {
            Ok(next) if !special => path = path.parent().unwrap_or(Path::new("")).join(next),
            _ => return Ok(path),
        }
    }
    Err(Error::other("too many symbolic links"))
}
