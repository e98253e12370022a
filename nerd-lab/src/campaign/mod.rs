//! Hostile input by the million, and runs that are killed.
//!
//! Good URDFs, specifications, tables, model folders and command lines are changed at random, by the crate `mutatis`, and used. Each
//! must be refused in words or be used to the end: no panic, no abort, nothing over its memory or time, no number that is not finite.
//! Runs that are killed must leave no half a file and go on as if nothing had been. What fails is kept, and belongs into
//! `assets/campaign/corpus.toml` once it is mended.

use std::collections::BTreeMap;

use crate::prelude::*;

mod bench;
mod case;
mod corpus;
mod crew;
mod files;
mod judge;
mod kills;
mod text;

use case::Kind;
use crew::try_all;
pub use crew::work;
pub use judge::Call;
use judge::{Outcome, Verdict};
use kills::KILLS;

/// Faults whose files are kept, at most.
const KEPT: usize = 200;

settings! {
    /// Changed inputs, and runs that are killed.
    pub struct Campaign {
        /// Cases in all, over the six kinds
        cases: u64 = 10_000, Whole(0..=1_000_000_000);
        /// Seed of what is changed
        seed: u64 = 0, Whole(SEEDS);
        /// Runs to kill at a random moment
        kills: u64 = 0, Whole(0..=1_000_000);
        /// Folder for the files of faults
        faults: PathBuf = "out/campaign".into(), Text;
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Found {
    /// By kind of input, what became of them.
    pub cases: BTreeMap<String, [u64; Outcome::NAMES.len()]>,
    pub kills: kills::Counts,
    /// Every fault in words; those of cases by number.
    pub faults: Vec<String>,
}

impl Experiment for Campaign {
    fn about(&self) -> Result<About> {
        Ok(About { name: "campaign".into(), seed: self.seed, effort: (self.cases + self.kills) as f64, inputs: Inputs::default() })
    }

    fn measure(&self) -> Result<Measured> {
        let (program, mut found) = (std::env::current_exe()?, Found::default());
        if self.cases > 0 {
            self.change(&program, &mut found)?;
        }
        found.kills = kills::kill(&program, self.kills, self.seed, &mut found.faults)?;
        Measured::new(&found, found.tables())
    }
}

impl Found {
    fn tables(&self) -> Vec<Table> {
        let row = |name: &String, counts: &[u64]| [vec![name.clone()], counts.iter().map(u64::to_string).collect()].concat();
        let case = |(name, counts): (&String, &[u64; 8])| row(name, &[&[counts.iter().sum()], &counts[..]].concat());
        let cases = Table::new("cases", &[&["input", "cases"], &Outcome::NAMES[..]].concat());
        let kills = Table::new("kills", &[&["command"], &KILLS[..]].concat());
        vec![cases.with(self.cases.iter().map(case)), kills.with(self.kills.iter().map(|(name, counts)| row(name, counts)))]
    }
}

impl Campaign {
    fn change(&self, program: &Path, found: &mut Found) -> Result<()> {
        let good = files::scratch()?;
        bench::build(program, good.path())?;
        let (bar, mut faults, mut done) = (bar("cases", self.cases), Vec::new(), 0);
        try_all(program, (self.seed, self.cases), good.path(), &mut |number, verdict| {
            let kind = Kind::of(number);
            let Verdict(outcome, words) = verdict;
            found.cases.entry(kind.name().into()).or_default()[outcome as usize] += 1;
            if outcome > Outcome::Accepted {
                found.faults.push(format!("case {number} ({}): {}: {words}", kind.name(), outcome.name()));
                faults.push((number, kind, outcome));
            }
            done += 1;
            bar.set(done);
        })?;
        bar.finish();
        let files = files::read(good.path())?;
        for (number, kind, outcome) in faults.into_iter().take(KEPT) {
            let mut case = kind.make(self.seed, number, &files);
            case.files.retain(|name, bytes| files.get(name) != Some(bytes));
            case.files.insert("line.txt".into(), case.line.into());
            files::write(&self.faults.join(format!("{}-{}-{number}", kind.name(), outcome.name().replace(' ', "-"))), &case.files)?;
        }
        Ok(())
    }
}

/// Tries the corpus in this process: how many cases it has, and those that did not end as they should.
pub fn replay(call: Call) -> Result<(usize, Vec<String>)> {
    let (good, here) = (files::scratch()?, files::scratch()?);
    bench::build(&std::env::current_exe()?, good.path())?;
    let (files, entries) = (files::read(good.path())?, corpus::entries()?);
    std::env::set_current_dir(here.path())?;
    nerd_train::progress::quiet();
    crew::keep_panics();
    let wrong = entries.iter().map(|entry| Ok(entry.wrong(&crew::caught(&entry.case(&files)?, call)?)));
    Ok((entries.len(), wrong.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect()))
}
