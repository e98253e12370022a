//! File locks: on a folder of results, for one writer at a time, and on temporary files, to recognise files of killed
//! writers. A lock ends with its process. On a file system without locks nothing is refused or removed.

use std::fs::{File, TryLockError};
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A folder claimed by [`claim`], until dropped or until the process ends. Dropping removes folders that the claim
/// created, if they are still empty.
#[derive(Debug)]
pub struct Claim {
    /// Folders that the claim created, innermost first.
    made: Vec<PathBuf>,
    _lock: File,
}

/// Claims a folder of results, and creates it if absent. Refused if another process, or another claim of this process,
/// writes there.
pub fn claim(folder: &Path) -> Result<Claim> {
    let named = |e: Error| Error::new(e.kind(), format!("{}: {e}", folder.display()));
    // A claim that ends may remove the folder just before the lock here; then create it again.
    for _ in 0..100 {
        let made =
            folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists()).map(PathBuf::from).collect();
        std::fs::create_dir_all(folder)
            .map_err(|e| if folder.is_file() { Error::new(e.kind(), "is a file, not a folder") } else { e })
            .map_err(named)?;
        let Ok((file, path)) = opened(folder) else { continue };
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => {
                let text = format!(
                    "{} is in use: another process writes there; wait for it, or choose another folder",
                    folder.display()
                );
                return Err(Error::new(ErrorKind::WouldBlock, text));
            }
            // On a file system without locks, other writers cannot be detected.
            Ok(()) | Err(TryLockError::Error(_)) => {}
        }
        if is_at(&file, &path) {
            return Ok(Claim { made, _lock: file });
        }
    }
    Err(Error::other(format!("{} comes and goes: another process makes and removes it", folder.display())))
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Stops, as intended, at the first folder that is not empty.
        let _ = self.made.iter().try_for_each(std::fs::remove_dir);
    }
}

/// The open file to lock, and its path: the folder itself, or a file in it where folders cannot be opened.
fn opened(folder: &Path) -> Result<(File, PathBuf)> {
    if cfg!(unix) {
        return Ok((File::open(folder)?, folder.into()));
    }
    let path = folder.join(".nerd-claim");
    Ok((File::create(&path)?, path))
}

const PREFIX: &str = ".nerd-";
const SUFFIX: &str = ".tmp";

/// Creates a locked temporary file in a folder.
pub(super) fn create(folder: &Path) -> Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // A temporary file is by default private to its owner; results get the permissions of the umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    // Another process may sweep the folder between creation and lock; then create the file again.
    for _ in 0..100 {
        let file = builder.prefix(PREFIX).suffix(SUFFIX).tempfile_in(folder)?;
        let locked = file.as_file().try_lock();
        if !matches!(locked, Err(TryLockError::WouldBlock)) && is_at(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
    Err(Error::other("another process removes every file that is started here"))
}

/// Removes temporary files that killed writers left in a folder, as far as possible.
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

/// Whether an open file is still the file at this path.
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
