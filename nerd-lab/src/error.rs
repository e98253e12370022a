//! Errors of the laboratory: one line for whoever gave the command.

use std::path::Path;

pub use anyhow::{Error, Result};

/// Of a file; for `map_err`.
pub fn file(path: &Path) -> impl Fn(std::io::Error) -> Error + '_ {
    move |source| Error::msg(format!("{}: {source}", path.display()))
}

/// Of what a file holds; for `map_err`.
pub fn format<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Error + '_ {
    move |reason| Error::msg(format!("{}: {reason}", path.display()))
}

/// Ends a function with this line.
macro_rules! refuse {
    ($($text:tt)*) => { anyhow::bail!($($text)*) };
}
pub(crate) use refuse;
