//! Partial files: their names, and which of them were left by killed writers.
//!
//! A writer holds a lock on its file, which ends with the process. On a file system without locks nothing is removed.

use std::fs::{File, TryLockError};
use std::io::{Error, Result};
use std::path::Path;

use tempfile::NamedTempFile;

const PREFIX: &str = ".nerd-";
const SUFFIX: &str = ".tmp";

/// A new file in a folder, locked.
pub(super) fn create(folder: &Path) -> Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // A temporary file is private to its owner; a result is for everybody the umask lets in.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    // Another process may sweep the folder between a file's creation and its lock: then it is made again.
    for _ in 0..100 {
        let file = builder.prefix(PREFIX).suffix(SUFFIX).tempfile_in(folder)?;
        let locked = file.as_file().try_lock();
        if !matches!(locked, Err(TryLockError::WouldBlock)) && is_at(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
    Err(Error::other("another process removes every file that is started here"))
}

/// Removes what killed writers left in a folder, as far as that can be done.
pub(super) fn sweep(folder: &Path) {
    let ours = |name: &str| name.starts_with(PREFIX) && name.ends_with(SUFFIX);
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(ours)
            && entry.file_type().is_ok_and(|kind| kind.is_file())
            && let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether an open file is still the one of that name.
pub(super) fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let of = |m: &std::fs::Metadata| (m.dev(), m.ino());
        matches!((file.metadata(), std::fs::metadata(path)), (Ok(a), Ok(b)) if of(&a) == of(&b))
    }
    #[cfg(not(unix))]
    {
        file.metadata().is_ok() && path.exists()
    }
}
