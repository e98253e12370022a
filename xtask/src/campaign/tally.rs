//! What the cases came to, and the faults that are kept to be shown.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;

use super::bench::{Bench, write};
use super::case::{Fault, Kind, Verdict};
use crate::table::markdown;

/// Counts by kind.
#[derive(Default)]
pub struct Tally {
    cases: BTreeMap<Kind, u64>,
    refused: BTreeMap<Kind, u64>,
    faults: BTreeMap<(Kind, Fault), u64>,
    /// Number and words of every fault.
    pub found: BTreeMap<u64, (Fault, String)>,
}

impl Tally {
    /// Counts one case.
    pub fn add(&mut self, number: u64, verdict: Verdict) {
        let kind = Kind::of(number);
        *self.cases.entry(kind).or_default() += 1;
        match verdict {
            Verdict::Accepted => {}
            Verdict::Refused(_) => *self.refused.entry(kind).or_default() += 1,
            Verdict::Fault(fault, words) => {
                *self.faults.entry((kind, fault)).or_default() += 1;
                self.found.insert(number, (fault, words));
            }
        }
    }

    /// Kinds in rows, and their sum.
    pub fn table(&self) -> String {
        let row = |name: &str, kinds: &[Kind]| {
            let sum = |of: &dyn Fn(&Kind) -> Option<u64>| kinds.iter().filter_map(of).sum::<u64>();
            let cases = sum(&|k| self.cases.get(k).copied());
            let refused = sum(&|k| self.refused.get(k).copied());
            let faults = Fault::ALL.map(|f| sum(&|k| self.faults.get(&(*k, f)).copied()));
            let accepted = cases - refused - faults.iter().sum::<u64>();
            let counts = [cases, refused, accepted].into_iter().chain(faults);
            std::iter::once(name.to_string()).chain(counts.map(|n| n.to_string())).collect::<Vec<_>>()
        };
        let mut rows: Vec<_> = Kind::ALL.iter().map(|k| row(k.name(), &[*k])).collect();
        rows.push(row("all", &Kind::ALL));
        let header: Vec<_> = ["input", "cases", "refused", "accepted"].into_iter().chain(Fault::ALL.map(Fault::name)).collect();
        markdown(&header, &rows)
    }

    /// Writes the files of each fault into a folder of its own, the words beside them; so many of them at most.
    pub fn keep(&self, seed: u64, folder: &Path, most: usize) -> Result<Vec<PathBuf>> {
        let bench = Bench::new()?;
        let kept = self.found.iter().take(most).map(|(number, (fault, words))| {
            let kind = Kind::of(*number);
            let path = folder.join(kind.name()).join(format!("{}-{number}", fault.name().replace(' ', "-")));
            write(&path, &kind.make(seed, *number, &bench))?;
            std::fs::write(path.join("words.txt"), words)?;
            Ok(path)
        });
        kept.collect()
    }
}
