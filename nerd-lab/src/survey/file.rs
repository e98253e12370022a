//! Files that may be robots.

use crate::prelude::*;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    pub path: PathBuf,
    /// Its path from the folder asked for.
    pub name: String,
}

/// `path`, or the .urdf files below it by name; also a folder below it that cannot be read. No link is followed.
pub fn find(path: &Path) -> std::io::Result<Vec<Found>> {
    let above = if path.metadata()?.is_dir() { path } else { path.parent().unwrap_or(path) };
    let mut files = Vec::new();
    search(path, above, &mut files);
    Ok(files)
}

fn search(path: &Path, above: &Path, files: &mut Vec<Found>) {
    let inside = if path.is_dir() { std::fs::read_dir(path).and_then(Iterator::collect::<std::io::Result<Vec<_>>>).ok() } else { None };
    let Some(mut inside) = inside else {
        files.push(Found { path: path.into(), name: path.strip_prefix(above).unwrap_or(path).display().to_string() });
        return;
    };
    inside.sort_by_key(std::fs::DirEntry::file_name);
    for entry in inside {
        // A link may lead back up.
        let (path, kind) = (entry.path(), entry.file_type());
        if kind.is_ok_and(|kind| kind.is_dir() || kind.is_file() && path.extension().is_some_and(|e| e == "urdf")) {
            search(&path, above, files);
        }
    }
}

/// The text of a file, or why it has none.
pub(super) fn text(path: &Path) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("cannot be read: {e}"))?;
    String::from_utf8(bytes).map_err(|e| format!("is not UTF-8 text: byte {}", e.utf8_error().valid_up_to()))
}

/// The message, without the name that its row already has.
pub(super) fn reason(error: &SystemError, name: &str) -> String {
    error.to_string().replace(&format!("robot `{name}`: "), "")
}
