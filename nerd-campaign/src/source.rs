//! Where cases come from: a seed, or the files of a corpus.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;

use crate::bench::Bench;
use crate::case::{Files, Kind};
use crate::corpus;

/// Cases by number.
#[derive(Clone, Debug)]
pub enum Source {
    /// So many good inputs, changed.
    Seed {
        /// Of what is changed.
        seed: u64,
        /// How many.
        cases: u64,
    },
    /// These files.
    Corpus(Vec<PathBuf>),
}

impl Source {
    /// Every file of a corpus below the paths.
    ///
    /// # Errors
    /// If a folder cannot be read.
    pub fn corpus(paths: &[PathBuf]) -> io::Result<Self> {
        Ok(Self::Corpus(corpus::files(paths)?))
    }

    /// How many cases there are.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> u64 {
        match self {
            Self::Seed { cases, .. } => *cases,
            Self::Corpus(files) => files.len() as u64,
        }
    }

    /// What a case is of.
    pub fn kind(&self, number: u64) -> Option<Kind> {
        match self {
            Self::Seed { .. } => Some(Kind::of(number)),
            Self::Corpus(files) => corpus::kind(files.get(number as usize)?),
        }
    }

    /// A case.
    ///
    /// # Errors
    /// If a file of the corpus is no case.
    pub fn case(&self, number: u64, bench: &Bench) -> io::Result<(Kind, Files)> {
        match self {
            Self::Seed { seed, .. } => Ok((Kind::of(number), Kind::of(number).make(*seed, number, bench))),
            Self::Corpus(files) => corpus::read(&files[number as usize], bench),
        }
    }

    /// The options that name it to a worker.
    pub fn arguments(&self) -> Vec<OsString> {
        match self {
            Self::Seed { seed, cases } => ["--seed", &seed.to_string(), "--cases", &cases.to_string()].map(OsString::from).into(),
            Self::Corpus(files) => files.iter().flat_map(|file| ["--replay".into(), file.into()]).collect(),
        }
    }
}
