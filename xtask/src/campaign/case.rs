//! A case: a few files made from a number, and what became of them. The same seed and number make the same bytes, so a case
//! that killed its process is made again to be shown.

use std::collections::BTreeMap;

use anyhow::Result;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::bench::Bench;
use super::{csv, line, model, toml, urdf};

/// Files by name.
pub type Files = BTreeMap<String, Vec<u8>>;

/// What is mutated.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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
        match number % 20 {
            0..6 => Self::Urdf,
            6..12 => Self::Toml,
            12..16 => Self::Csv,
            16..19 => Self::Model,
            _ => Self::Line,
        }
    }

    /// Its name in tables and folders.
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Toml => "toml",
            Self::Csv => "csv",
            Self::Model => "model",
            Self::Line => "line",
        }
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
    pub fn judge(self, files: &Files, bench: &Bench) -> Result<Verdict> {
        match self {
            Self::Urdf => Ok(urdf::judge(files)),
            Self::Toml => Ok(toml::judge(files)),
            Self::Csv => csv::judge(files, bench),
            Self::Model => model::judge(files, bench),
            Self::Line => line::judge(files, bench),
        }
    }
}

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
    /// All, in the order of the table.
    pub const ALL: [Self; 6] = [Self::Panic, Self::Abort, Self::Memory, Self::Time, Self::NotFinite, Self::Untidy];

    /// Its column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Panic => "panics",
            Self::Abort => "aborts",
            Self::Memory => "over memory",
            Self::Time => "over time",
            Self::NotFinite => "not finite",
            Self::Untidy => "untidy",
        }
    }
}

/// A file's text, as programs that read text see it; none if it is not UTF-8.
pub fn text<'a>(files: &'a Files, name: &str) -> Option<&'a str> {
    std::str::from_utf8(files.get(name)?).ok()
}
