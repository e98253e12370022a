//! What a campaign found: counts, and faults by their sort.

use super::Kind;
use crate::prelude::*;

/// Counts by kind, and what must not happen.
#[derive(Clone, Debug, Default)]
pub struct Found {
    pub counts: BTreeMap<Kind, [u64; 3]>,
    pub faults: Vec<(Kind, u64, String)>,
}

impl Found {
    /// What must not happen: of each sort, the most frequent first, how often, and one of them with how to try it again.
    pub fn lines(&self, seed: u64) -> Vec<String> {
        let mut sorts = BTreeMap::<(Kind, String), Vec<&(Kind, u64, String)>>::new();
        for fault in &self.faults {
            sorts.entry((fault.0, sort(&fault.2))).or_default().push(fault);
        }
        let mut sorts: Vec<_> = sorts.into_values().collect();
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
            std::iter::once(kind.name()).chain(counts.map(|n| n.to_string())).collect()
        };
        Table::new("campaign", &["input", "cases", "refused", "accepted", "faults"]).with(self.counts.iter().map(row))
    }
}

/// A fault without names and numbers.
fn sort(what: &str) -> String {
    let words = what.split(['\'', '`']).step_by(2).collect::<Vec<_>>().join("_");
    words.split(|c: char| c.is_ascii_digit() || ".-".contains(c)).filter(|part| !part.is_empty()).collect::<Vec<_>>().join("#")
}
