//! Reads and writes files through [`nerd_sim::files`]; errors name the file.

use nerd_sim::files;

use crate::prelude::*;

/// Replaces a file, and creates its folder if absent.
pub(crate) fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<()> {
    files::write(path, bytes.as_ref()).map_err(Error::file(path))
}

/// Reads a text file.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    files::read_text(path).map_err(Error::file(path))
}

/// Reads a record of a run (JSON lines), which only free memory limits in size.
pub(crate) fn read_record(path: &Path) -> Result<String> {
    files::read_record(path).map_err(Error::file(path))
}
