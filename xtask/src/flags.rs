//! Options that would be read by nobody are refused, not ignored: who gave one meant something by it.

use anyhow::{Result, bail};

/// Refuses the first of `options`, names and whether they were given, that was; `when` says why it means nothing.
pub fn unused(options: &[(&str, bool)], when: &str) -> Result<()> {
    match options.iter().find(|(_, given)| *given) {
        Some((option, _)) => bail!("{option} means nothing {when}"),
        None => Ok(()),
    }
}
