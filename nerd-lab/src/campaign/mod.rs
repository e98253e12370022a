//! Hostile input by the million, and runs that are killed.
//!
//! Good URDFs, specifications, tables, model folders and command lines are changed at random and used. Each must be refused in
//! words or be used to the end: no panic, no abort within [`MEMORY`], nothing over [`SECONDS`], no number that is not finite.
//! Runs that are killed must leave no half a file and go on as if nothing had been.
//!
//! Cases are tried in processes of the program itself: its verb `campaign` takes `--work FIRST,STRIDE --seed SEED --cases CASES
//! --replay FILE ..` and calls [`work`]. What fails is kept, and belongs into `corpus/` once it is mended.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};

use crate::error::Result;
use crate::experiments::{Experiment, Measured};
use crate::report::Inputs;
use nerd_train::progress::bar;

mod bench;
mod case;
mod corpus;
mod crew;
mod csv;
mod files;
mod found;
mod kills;
mod line;
mod model;
mod mutate;
mod robots;
mod source;
mod toml;
mod urdf;
mod worker;

pub use found::Found;
pub use source::Source;
pub use worker::work;

/// What a case may take (s).
pub const SECONDS: u64 = 10;
/// Address space of a process (bytes).
pub const MEMORY: u64 = 4 << 30;
/// Faults whose files are kept, at most.
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
#[derive(Debug)]
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

/// Changed inputs, and kills.
#[derive(Clone, Debug)]
pub struct Campaign {
    /// What is tried.
    pub program: Program,
    /// Of what is changed.
    pub seed: u64,
    /// Inputs over the five kinds.
    pub cases: u64,
    /// Runs to kill at a random moment.
    pub kills: u64,
    /// Folder for the files of faults.
    pub kept: PathBuf,
}

impl Experiment for Campaign {
    fn name(&self) -> String {
        "campaign".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.cases + self.kills) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        Ok(Inputs::default())
    }

    fn measure(&self) -> Result<Measured> {
        let found = self.tried()?;
        Measured::new(&found, found.tables())
    }
}

impl Campaign {
    fn tried(&self) -> io::Result<Found> {
        let (found, bar) = (Mutex::new((Found::default(), BTreeMap::new(), 0)), bar("cases", self.cases));
        let source = Source { seed: self.seed, cases: self.cases, ..Source::default() };
        crew::try_all(&self.program.path, &source, &|number, verdict| {
            let Ok(mut guard) = found.lock() else { return };
            let (found, faults, done) = &mut *guard;
            faults.extend(found.add(number, verdict).map(|fault| (number, fault)));
            *done += 1;
            bar.say(&format!("{} faults", faults.len()));
            bar.set(*done);
        })?;
        bar.finish();
        let (mut found, faults, _) = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        let bench = bench::Bench::new(self.program.clone())?;
        for (number, fault) in faults.into_iter().take(KEPT) {
            let kind = case::Kind::of(number);
            let folder = self.kept.join(kind.name()).join(format!("{}-{number}", fault.name().replace(' ', "-")));
            bench::write(&folder, &kind.make(self.seed, number, &bench))?;
        }
        kills::kill(&self.program.path, self.kills, self.seed, &mut found)?;
        Ok(found)
    }
}

/// Tries every file of a corpus below the paths, in order: `KIND/NAME: ` and `accepted`, `refused: WORDS` or `FAULT ..`.
///
/// # Errors
/// If a file cannot be read, or is no case.
pub fn replay(program: &Program, paths: &[PathBuf]) -> io::Result<Vec<String>> {
    let source = Source { corpus: corpus::files(paths)?, ..Source::default() };
    let said = Mutex::new(BTreeMap::new());
    crew::try_all(&program.path, &source, &|number, verdict| {
        let words = corpus::words(&source.corpus[number as usize], verdict);
        said.lock().unwrap_or_else(PoisonError::into_inner).insert(number, words);
    })?;
    Ok(said.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect())
}

/// A process that is not heard, does not ask git where results come from, and uses one thread.
fn calm(command: &mut Command) -> &mut Command {
    let variables = [("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1"), ("RUST_BACKTRACE", "0")];
    command.envs(variables).stdin(Stdio::null()).stdout(Stdio::null())
}
