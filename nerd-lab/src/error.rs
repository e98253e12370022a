//! Errors of files: one line that names the file; for `map_err`.

use crate::prelude::*;

/// Of reading or writing it.
pub fn file(path: &Path) -> impl Fn(std::io::Error) -> Error + '_ {
    format(path)
}

/// Of what it holds.
pub fn format<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Error + '_ {
    move |reason| Error::msg(format!("{}: {reason}", path.display()))
}
