//! A case: a few files made from a number, and what became of them. The same seed and number make the same bytes, so a case
//! that killed its process is made again to be shown.

use std::collections::BTreeMap;
use std::error::Error;
use std::io;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::campaign::bench::Bench;
use crate::campaign::{csv, line, model, toml, urdf};

/// Files by name.
pub type Files = BTreeMap<String, Vec<u8>>;

/// What is mutated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// URDFs, bare, on a fixed and on a free base.
    Urdf,
    /// Specifications and their URDFs: starts, scenes, data, motion.
    Toml,
    /// Tables of states, as `rollout` reads them.
    Csv,
    /// Folders of models.
    Model,
    /// Command lines.
    Line,
}

impl Kind {
    /// All, in the order of the table.
    pub const ALL: [Self; 5] = [Self::Urdf, Self::Toml, Self::Csv, Self::Model, Self::Line];

    /// The kind of a case: of twenty in a row six, six, four, three and one, since a command line costs a process.
    pub fn of(number: u64) -> Self {
        let at = [6, 12, 16, 19, 20].iter().position(|end| number % 20 < *end);
        Self::ALL[at.unwrap_or(0)]
    }

    /// Its name in tables and folders.
    pub fn name(self) -> &'static str {
        ["urdf", "toml", "csv", "model", "line"][self as usize]
    }

    /// The files of a case.
    pub fn make(self, seed: u64, number: u64, bench: &Bench) -> Files {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(number);
        match self {
            Self::Urdf => urdf::make(&mut rng),
            Self::Toml => toml::make(&mut rng),
            Self::Csv => csv::make(&mut rng),
            Self::Model => model::make(&mut rng, bench),
            Self::Line => line::make(&mut rng),
        }
    }

    /// Uses the files as the program would.
    ///
    /// # Errors
    /// If the campaign itself fails: the disk is full, say.
    pub fn judge(self, files: &Files, bench: &Bench) -> io::Result<Verdict> {
        let judged = match self {
            Self::Urdf => urdf::judge(files),
            Self::Toml => toml::judge(files),
            Self::Csv => csv::judge(files, bench)?,
            Self::Model => model::judge(files, bench)?,
            Self::Line => line::judge(files, bench)?,
        };
        Ok(judged.err().unwrap_or(Verdict::Accepted))
    }
}

/// Nothing, or why a case was not used to the end.
pub type Judged = Result<(), Verdict>;

/// What became of a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Verdict {
    /// Refused, in these words.
    Refused(String),
    /// Used.
    Accepted,
    /// Neither.
    Fault(Fault, String),
}

/// An error of what is tried is a refusal.
impl<E: Error> From<E> for Verdict {
    fn from(error: E) -> Self {
        Self::Refused(error.to_string())
    }
}

/// A fault, with its words.
pub fn fault(fault: Fault, words: impl Into<String>) -> Judged {
    Err(Verdict::Fault(fault, words.into()))
}

/// What must not happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Fault {
    /// A panic.
    Panic,
    /// The process died of a signal.
    Abort,
    /// It asked for more memory than there is.
    Memory,
    /// It took too long.
    Time,
    /// A number that is not finite was accepted, or came out.
    NotFinite,
    /// A refusal left files or no words, or a result is not whole.
    Untidy,
}

impl Fault {
    /// Columns of all.
    pub const NAMES: [&str; 6] = ["panics", "aborts", "over memory", "over time", "not finite", "untidy"];

    /// Its column.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

/// A file's text, as programs that read text see it.
pub fn text<'a>(files: &'a Files, name: &str) -> Result<&'a str, Verdict> {
    let bytes = files.get(name).ok_or_else(|| Verdict::Refused(format!("no {name}")))?;
    Ok(std::str::from_utf8(bytes)?)
}
