//! Standard output, which may be closed (`| head`) or full: neither ends a command before it has written its files.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};
use std::path::Path;
use std::sync::OnceLock;

use anyhow::{Result, bail};
use nerd_train::experiments::{self, Experiment};
use nerd_train::report::Table;

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

/// Tables, one below the other.
pub fn tables(tables: &[Table]) {
    tables.iter().for_each(|table| println!("{}", table.markdown()));
}

/// Measures an experiment into a folder and shows its tables.
pub fn conduct<E: Experiment>(experiment: &E, out: &Path) -> Result<()> {
    tables(&experiments::conduct(experiment, out)?.tables);
    eprintln!("written to {}", out.display());
    Ok(())
}
