//! Output files: there whole or not at all.

use std::io::{Result, Write};
use std::path::Path;

/// Replaces the file at `path` (its folder is made if absent) by `bytes`; see [`write_with`].
///
/// # Errors
/// What the file system says.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// Replaces the file at `path` by what `fill` writes, under a temporary name first, so whoever reads `path` sees an old or
/// a new file, never half of one.
///
/// # Errors
/// What `fill` returns or the file system says; then an older file at `path` is untouched.
///
/// ```
/// let path = std::env::temp_dir().join("nerd-files-example.txt");
/// nerd_sim::files::write(&path, b"whole")?;
/// let full = |file: &mut dyn std::io::Write| file.write_all(b"ha").and(Err(std::io::Error::other("disk full")));
/// assert!(nerd_sim::files::write_with(&path, full).is_err());
/// assert_eq!(std::fs::read(&path)?, b"whole");
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write_with(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    // A temporary file is private to its owner; a result is for everybody the umask lets in.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.suffix(".tmp").tempfile_in(folder)?;
    fill(&mut file)?;
    // On the disk before the rename is: otherwise a power cut may leave the new name with no content.
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Writes files into a folder in their order: at once where the folder is not there yet, or else one after the other. What
/// marks it as complete comes last.
///
/// # Errors
/// What the file system says; then a folder that was not there is not there.
pub fn write_folder(folder: &Path, files: &[(&str, Vec<u8>)]) -> Result<()> {
    if folder.exists() {
        return files.iter().try_for_each(|(name, bytes)| write(&folder.join(name), bytes));
    }
    let parent = folder.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(parent)?;
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    let made = builder.suffix(".tmp").tempdir_in(parent)?;
    files.iter().try_for_each(|(name, bytes)| write(&made.path().join(name), bytes))?;
    std::fs::rename(made.path(), folder)?;
    // Its name is the folder's now: nothing is left to be taken away.
    let _ = made.keep();
    Ok(())
}
