//! Refusals, of one line each.

use crate::prelude::*;

/// Of reading or writing a file, or of what it holds, with its name; for `map_err`.
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
