//! Where cases come from: a seed, or the files of a corpus.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;

use crate::campaign::bench::Bench;
use crate::campaign::case::{Files, Kind};
use crate::campaign::corpus;

/// Cases by number: the files of a corpus or, if there are none, good inputs that are changed.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Seed of the changes.
    pub seed: u64,
    /// How many inputs are changed.
    pub cases: u64,
    /// Files of a corpus.
    pub corpus: Vec<PathBuf>,
}

impl Source {
    /// How many cases there are.
    pub(crate) fn count(&self) -> u64 {
        if self.corpus.is_empty() { self.cases } else { self.corpus.len() as u64 }
    }

    /// What a case is of.
    pub(crate) fn kind(&self, number: u64) -> Option<Kind> {
        self.corpus.get(number as usize).map_or_else(|| Some(Kind::of(number)), |file| corpus::kind(file))
    }

    /// A case.
    pub(crate) fn case(&self, number: u64, bench: &Bench) -> io::Result<(Kind, Files)> {
        match self.corpus.get(number as usize) {
            Some(file) => corpus::read(file, bench),
            None => Ok((Kind::of(number), Kind::of(number).make(self.seed, number, bench))),
        }
    }

    /// The options that name it to a worker.
    pub(crate) fn arguments(&self) -> Vec<OsString> {
        let [seed, cases] = [self.seed, self.cases].map(|n| n.to_string().into());
        let corpus = self.corpus.iter().flat_map(|file| ["--replay".into(), file.into()]);
        ["--seed".into(), seed, "--cases".into(), cases].into_iter().chain(corpus).collect()
    }
}
