//! Standard output. If it is closed (`| head`) or full, the command still writes its files. With `--json`, only tables
//! are printed, as one JSON object from names to rows.

use std::io::{ErrorKind, Write, stdout};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::{fmt::Arguments, path::Path};

use anyhow::{Result, bail};
use nerd_sim::files::replaceable;
use nerd_train::replay::Replay;

use crate::experiments::{self, Experiment};
use crate::report::{self, Artifact, Table};

static LOST: OnceLock<String> = OnceLock::new();
static TABLES: OnceLock<Mutex<serde_json::Map<String, serde_json::Value>>> = OnceLock::new();

/// Switches to JSON: tables are then kept for [`finish`], and other lines go to standard error.
pub fn json() {
    TABLES.get_or_init(Mutex::default);
}

/// Prints a line to standard output; with `--json`, to standard error.
pub fn line(text: Arguments) {
    match TABLES.get() {
        Some(_) => tell!("{text}"),
        None => write(text),
    }
}

/// Prints a table in Markdown, or keeps it for JSON.
pub fn table(table: &Table) {
    if !keep(table) {
        write(format_args!("{}", table.markdown()));
    }
}

/// Keeps a table for JSON; returns whether JSON was requested.
pub fn keep(table: &Table) -> bool {
    let Some(tables) = TABLES.get() else { return false };
    tables.lock().unwrap_or_else(PoisonError::into_inner).insert(table.name.clone(), table.json());
    true
}

pub fn tables(tables: &[Table]) {
    tables.iter().for_each(table);
}

/// Measures an experiment into a folder and prints its tables.
pub fn conduct(experiment: &dyn Experiment, out: &Path) -> Result<Artifact> {
    let artifact = experiments::conduct(experiment, out)?;
    tables(&artifact.tables);
    Ok(artifact)
}

/// Text that identifies HTML pages of this program.
const MARK: &str = "<meta name=\"generator\" content=\"NeRD in Rust\">";

/// Refuses, before any work, to replace a file that is not a page of this program.
pub fn page(path: &Path) -> Result<()> {
    Ok(replaceable(path, |bytes| bytes.windows(MARK.len()).take(1000).any(|at| at == MARK.as_bytes()))?)
}

pub fn replay(path: &Path, replay: &Replay) -> Result<()> {
    report::write(path, replay.html().as_bytes())?;
    tell!("replay written to {}", path.display());
    Ok(())
}

/// Prints the tables that are kept for JSON. Fails if output was lost, except to a closed pipe.
pub fn finish() -> Result<()> {
    if let Some(tables) = TABLES.get() {
        write(format_args!(
            "{:#}",
            serde_json::Value::Object(tables.lock().unwrap_or_else(PoisonError::into_inner).clone())
        ));
    }
    match LOST.get() {
        Some(error) => bail!("standard output: {error}; files are written all the same"),
        None => Ok(()),
    }
}

fn write(text: Arguments) {
    // Ignores a closed pipe, whose reader has read enough.
    if let Err(error) = writeln!(stdout().lock(), "{text}").and_then(|()| stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = LOST.set(error.to_string());
    }
}
