//! Refusals, of one line each.

use crate::prelude::*;

/// Adds a file's name to an error of reading, writing or parsing it; for `map_err`.
pub(crate) fn file<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Error + '_ {
    move |reason| Error::msg(format!("{}: {reason}", path.display()))
}

/// Of the first of `options`, names and whether they were given, that was given without effect.
pub fn unused(options: &[(&str, bool)], when: &str) -> Result<()> {
    match options.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("{option} means nothing {when}"),
        None => Ok(()),
    }
}
