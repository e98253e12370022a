//! Standard output, which may be closed (`| head`) or full without ending a command before it has written its files. With `--json` it
//! holds only the tables, as one object: names, and rows as objects.

use std::io::{ErrorKind, Write, stdout};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::{fmt::Arguments, path::Path};

use anyhow::{Result, bail};
use nerd_lab::experiments::{self, Experiment};
use nerd_lab::report::{Artifact, Table};
use nerd_sim::files::replaceable;
use nerd_train::replay::Replay;

static LOST: OnceLock<String> = OnceLock::new();
static TABLES: OnceLock<Mutex<serde_json::Map<String, serde_json::Value>>> = OnceLock::new();

/// From now on tables are kept for [`finish`], and all other lines go to standard error.
pub fn json() {
    TABLES.get_or_init(Mutex::default);
}

/// A line, as `println!` writes it.
pub fn line(text: Arguments) {
    match TABLES.get() {
        Some(_) => tell!("{text}"),
        None => write(text),
    }
}

/// A table, in Markdown unless JSON was asked for.
pub fn table(table: &Table) {
    if !keep(table) {
        write(format_args!("{}", table.markdown()));
    }
}

/// A table for JSON alone; whether that was asked for.
pub fn keep(table: &Table) -> bool {
    let Some(tables) = TABLES.get() else { return false };
    tables.lock().unwrap_or_else(PoisonError::into_inner).insert(table.name.clone(), table.json());
    true
}

pub fn tables(tables: &[Table]) {
    tables.iter().for_each(table);
}

/// Measures an experiment into a folder and shows its tables.
pub fn conduct(experiment: &dyn Experiment, out: &Path) -> Result<Artifact> {
    let artifact = experiments::conduct(experiment, out)?;
    tables(&artifact.tables);
    Ok(artifact)
}

/// What all pages of this program have.
const MARK: &str = "<meta name=\"generator\" content=\"NeRD in Rust\">";

/// Refuses to replace a file that is no page of this program, before it is made.
pub fn page(path: &Path) -> Result<()> {
    Ok(replaceable(path, |bytes| bytes.windows(MARK.len()).take(1000).any(|at| at == MARK.as_bytes()))?)
}

pub fn replay(path: &Path, replay: &Replay) -> Result<()> {
    nerd_lab::report::write(path, replay.html().as_bytes())?;
    tell!("replay written to {}", path.display());
    Ok(())
}

/// Writes the buffered output, and returns whether all lines were written or not wanted.
pub fn finish() -> Result<()> {
    if let Some(tables) = TABLES.get() {
        write(format_args!("{:#}", serde_json::Value::Object(tables.lock().unwrap_or_else(PoisonError::into_inner).clone())));
    }
    match LOST.get() {
        Some(error) => bail!("standard output: {error}; files are written all the same"),
        None => Ok(()),
    }
}

fn write(text: Arguments) {
    // Who closes a pipe has read enough.
    if let Err(error) = writeln!(stdout().lock(), "{text}").and_then(|()| stdout().flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = LOST.set(error.to_string());
    }
}
