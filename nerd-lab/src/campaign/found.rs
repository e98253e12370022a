//! What the cases and the kills came to.

use std::collections::BTreeMap;

use crate::report::Table;
use serde::{Deserialize, Serialize};

use crate::campaign::case::{Fault, Kind, Verdict};
use crate::campaign::kills::KILLS;

/// Counts and faults.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Found {
    /// By kind of input: refused, accepted, then faults by their kind.
    pub cases: BTreeMap<String, [u64; 2 + Fault::NAMES.len()]>,
    /// By command, what became of killed runs.
    pub kills: BTreeMap<String, [u64; KILLS.len()]>,
    /// Every fault in words; those of cases by number.
    pub faults: Vec<String>,
}

impl Found {
    /// Counts one case, and says whether it was a fault.
    pub(crate) fn add(&mut self, number: u64, verdict: Verdict) -> Option<Fault> {
        let kind = Kind::of(number).name();
        let counts = self.cases.entry(kind.into()).or_default();
        match verdict {
            Verdict::Refused(_) => counts[0] += 1,
            Verdict::Accepted => counts[1] += 1,
            Verdict::Fault(fault, words) => {
                counts[2 + fault as usize] += 1;
                self.faults.push(format!("case {number} ({kind}): {}: {words}", fault.name()));
                return Some(fault);
            }
        }
        None
    }

    /// Inputs by kind with their sum, and commands, where there were any.
    pub(crate) fn tables(&self) -> Vec<Table> {
        let row = |name: &str, counts: &[u64]| std::iter::once(name.into()).chain(counts.iter().map(u64::to_string)).collect();
        let case = |name: &str, counts: &[u64]| row(name, &[&[counts.iter().sum()], counts].concat());
        let all: Vec<u64> = (0..8).map(|column| self.cases.values().map(|counts| counts[column]).sum()).collect();
        let rows = self.cases.iter().map(|(kind, counts)| case(kind, counts)).chain([case("all", &all)]);
        let cases = Table::new("cases", &[&["input", "cases", "refused", "accepted"], &Fault::NAMES[..]].concat()).with(rows);
        let rows = self.kills.iter().map(|(command, counts)| row(command, counts));
        let kills = Table::new("kills", &[&["command"], &KILLS[..]].concat()).with(rows);
        let there = [(cases, self.cases.is_empty()), (kills, self.kills.is_empty())];
        there.into_iter().filter(|(_, empty)| !empty).map(|(table, _)| table).collect()
    }
}
