//! Results of a fuzz campaign: counts of outcomes, and faults grouped by message.

use super::Kind;
use crate::prelude::*;

/// Results of a campaign.
#[derive(Default)]
pub struct Found {
    /// Numbers of cases refused, accepted and at fault, by kind of input.
    pub counts: BTreeMap<Kind, [u64; 3]>,
    /// Kind of input, case number and message of each fault.
    pub faults: Vec<(Kind, u64, String)>,
}

impl Found {
    /// Describes each group of faults in one line, the largest group first. A line has the group's size, its first
    /// fault, and the options that repeat that case.
    pub fn lines(&self, seed: u64) -> Vec<String> {
        let mut sorts = BTreeMap::<(Kind, String), Vec<&(Kind, u64, String)>>::new();
        for fault in &self.faults {
            sorts.entry((fault.0, sort(&fault.2))).or_default().push(fault);
        }
        let mut sorts = sorts.into_values().collect_vec();
        sorts.sort_by_key(|faults| std::cmp::Reverse(faults.len()));
        let line = |faults: Vec<&(Kind, u64, String)>| {
            let (kind, number, what) = faults[0];
            let kind = kind.name();
            format!("{} {kind}: {what} (--kinds {kind} --seed {seed} --first {number} --cases 1)", faults.len())
        };
        sorts.into_iter().map(line).collect()
    }

    pub fn table(&self) -> Table {
        let row = |(kind, [refused, accepted, faults]): (&Kind, &[u64; 3])| {
            let counts = [refused + accepted + faults, *refused, *accepted, *faults];
            std::iter::once(kind.name()).chain(counts.map(|n| n.to_string()))
        };
        Table::new("campaign", ["input", "cases", "refused", "accepted", "faults"]).with(self.counts.iter().map(row))
    }
}

/// Returns a fault's message without quoted names and numbers: the key by which faults are grouped.
fn sort(what: &str) -> String {
    let words = what.split(['\'', '`']).step_by(2).join("_");
    words.split(|c: char| c.is_ascii_digit() || ".-".contains(c)).filter(|part| !part.is_empty()).join("#")
}
