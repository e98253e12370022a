//! Hostile input by the million, and runs that are killed.
//!
//! Good URDFs, specifications, tables, model folders and command lines are changed at random and used. Each must be refused in
//! words or be used to the end: no panic, no abort within [`MEMORY`], nothing over [`SECONDS`], no number that is not finite.
//! Runs that are killed must leave no half a file and go on as if nothing had been.
//!
//! Cases are tried in processes of the program itself: its verb `campaign` takes `--work FIRST,STRIDE` with the options of
//! [`Source::arguments`] and calls [`work`]. What fails is kept, and belongs into `corpus/` once it is mended.

#![warn(missing_docs)]

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;

mod bench;
mod case;
mod corpus;
mod crew;
mod csv;
mod files;
mod kills;
mod line;
mod model;
mod mutate;
mod robots;
mod source;
mod tally;
mod toml;
mod urdf;
mod worker;

pub use source::Source;
pub use worker::work;

use tally::Tally;

/// What a case may take (s).
pub const SECONDS: u64 = 10;
/// Address space of a process (bytes).
pub const MEMORY: u64 = 4 << 30;
/// Faults that are written out, at most.
const KEPT: usize = 200;

/// What is tried.
#[derive(Clone, Debug)]
pub struct Program {
    /// The executable.
    pub path: PathBuf,
    /// Its verb `rollout`, called for tables: a process for each would be most of their time.
    pub rollout: fn(&Rollout) -> Result<(), String>,
}

/// Options of a rollout.
pub struct Rollout<'a> {
    /// A robot's name.
    pub robot: &'a str,
    /// One of its scenes.
    pub scene: &'a str,
    /// Table of states and torques.
    pub states: &'a Path,
    /// File to write.
    pub out: &'a Path,
}

/// Numbers under a header, as text.
#[derive(Clone, Debug)]
pub struct Table {
    /// Names of the columns.
    pub header: Vec<&'static str>,
    /// As many cells in each as the header has.
    pub rows: Vec<Vec<String>>,
}

/// What was found.
#[derive(Debug)]
pub struct Outcome {
    /// Cases by kind, then kills by command, where there were any.
    pub tables: Vec<Table>,
    /// Every fault in words.
    pub faults: Vec<String>,
    /// Folders that hold the files of the first faults.
    pub kept: Vec<PathBuf>,
}

/// Tries `cases` changed inputs and kills `kills` runs; files of faults go to a folder. `told` hears what is done, of how
/// many, and with how many faults.
///
/// # Errors
/// If the campaign itself fails: the disk is full, say.
pub fn campaign(
    program: &Program,
    (seed, cases, kills): (u64, u64, u64),
    faults: &Path,
    told: &(dyn Fn(&str, u64, usize) + Sync),
) -> io::Result<Outcome> {
    let tally = Mutex::new((Tally::default(), 0));
    crew::try_all(&program.path, &Source::Seed { seed, cases }, &|number, verdict| {
        let Ok(mut tally) = tally.lock() else { return };
        tally.0.add(number, verdict);
        tally.1 += 1;
        told("cases", tally.1, tally.0.found.len());
    })?;
    let (tally, _) = tally.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    let (killed, untidy) = kills::kill(&program.path, kills, seed, &|done| told("kills", done, tally.found.len()))?;
    let tables = [(cases, tally.table()), (kills, killed)];
    Ok(Outcome {
        tables: tables.into_iter().filter(|(n, _)| *n > 0).map(|(_, table)| table).collect(),
        faults: tally.words().chain(untidy).collect(),
        kept: tally.keep(program.clone(), seed, faults, KEPT)?,
    })
}

/// Tries every file of a corpus below the paths, in order: `KIND/NAME: ` and `accepted`, `refused: WORDS` or `FAULT ..`.
///
/// # Errors
/// If a file cannot be read, or is no case.
pub fn replay(program: &Program, paths: &[PathBuf]) -> io::Result<Vec<String>> {
    let source = Source::corpus(paths)?;
    let said = Mutex::new(std::collections::BTreeMap::new());
    crew::try_all(&program.path, &source, &|number, verdict| {
        if let Ok(mut said) = said.lock() {
            said.insert(number, verdict);
        }
    })?;
    let said = said.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    Ok(corpus::words(&source, &said))
}

/// A process that is not heard, does not ask git where results come from, and uses one thread.
fn calm(command: &mut Command) -> &mut Command {
    let variables = [("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1"), ("RUST_BACKTRACE", "0")];
    command.envs(variables).stdin(Stdio::null()).stdout(Stdio::null())
}
