//! Errors of files: one line that names the file; for `map_err`.

use crate::prelude::*;

/// Of reading or writing it, or of what it holds.
pub fn file<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Error + '_ {
    move |reason| Error::msg(format!("{}: {reason}", path.display()))
}
