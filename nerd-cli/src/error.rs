//! Makes errors of one line each.

use crate::prelude::*;

/// Prefixes an error with a file's name, for `map_err`.
pub fn file<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Error + '_ {
    move |reason| Error::msg(format!("{}: {reason}", path.display()))
}

/// Refuses the first of `options` (name, whether given) that was given although it has no effect.
pub fn unused(options: &[(&str, bool)], when: &str) -> Result<()> {
    match options.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("{option} means nothing {when}"),
        None => Ok(()),
    }
}
