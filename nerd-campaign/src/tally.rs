//! What the cases came to, and the faults that are kept to be shown.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use crate::bench::{Bench, write};
use crate::case::{Fault, Kind, Verdict};
use crate::{Program, Table};

/// Counts by kind.
#[derive(Default)]
pub struct Tally {
    /// Refused, accepted, then the faults.
    counts: [[u64; 2 + Fault::NAMES.len()]; Kind::ALL.len()],
    /// Number and words of every fault.
    pub found: BTreeMap<u64, (Fault, String)>,
}

impl Tally {
    /// Counts one case.
    pub fn add(&mut self, number: u64, verdict: Verdict) {
        let column = match verdict {
            Verdict::Refused(_) => 0,
            Verdict::Accepted => 1,
            Verdict::Fault(fault, words) => {
                self.found.insert(number, (fault, words));
                2 + fault as usize
            }
        };
        self.counts[Kind::of(number) as usize][column] += 1;
    }

    /// Kinds in rows, and their sum.
    pub fn table(&self) -> Table {
        let all = std::array::from_fn(|column| self.counts.iter().map(|kind| kind[column]).sum());
        let names = Kind::ALL.map(Kind::name).into_iter().chain(["all"]);
        let row = |(name, counts): (&str, &[u64; 8])| {
            let numbers = std::iter::once(counts.iter().sum()).chain(*counts).map(|n: u64| n.to_string());
            std::iter::once(name.to_string()).chain(numbers).collect()
        };
        let header = ["input", "cases", "refused", "accepted"].into_iter().chain(Fault::NAMES).collect();
        Table { header, rows: names.zip(self.counts.iter().chain([&all])).map(row).collect() }
    }

    /// The faults in words.
    pub fn words(&self) -> impl Iterator<Item = String> {
        self.found.iter().map(|(n, (fault, words))| format!("case {n} ({}): {}: {words}", Kind::of(*n).name(), fault.name()))
    }

    /// Writes the files of each fault into a folder of its own, the words beside them; so many of them at most.
    pub fn keep(&self, program: Program, seed: u64, folder: &Path, most: usize) -> io::Result<Vec<PathBuf>> {
        let bench = Bench::new(program)?;
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
