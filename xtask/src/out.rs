//! Standard output, which may be closed (`| head`) or full: neither ends a command before it has written its files.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};
use std::sync::OnceLock;

use anyhow::{Result, bail};

static LOST: OnceLock<String> = OnceLock::new();

/// A line, as `println!` writes it.
pub fn line(text: Arguments) {
    // Who closes a pipe has read enough.
    if let Err(error) = writeln!(stdout().lock(), "{text}").and_then(|()| stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = LOST.set(error.to_string());
    }
}

/// Whether all lines came out, but for those that nobody wanted.
pub fn check() -> Result<()> {
    match LOST.get() {
        Some(error) => bail!("standard output: {error}; files are written all the same"),
        None => Ok(()),
    }
}
