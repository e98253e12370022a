//! Hostile input by the million, and runs that are killed.
//!
//! Good URDFs, specifications, tables, model folders and command lines are changed at random and used. Each
//! must be refused in words or be used to the end: no panic, no abort, nothing over its memory or time, no number that is not finite.
//! Runs that are killed must leave no half a file and go on as if nothing had been. What fails is kept, and belongs into
//! `assets/campaign/corpus.toml` once it is mended.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::prelude::*;

mod case;
mod corpus;
mod files;
mod judge;
mod kills;
mod text;

use case::Kind;
use judge::{Outcome, Verdict, judge};
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
        let files = good(program)?;
        let (bar, heard) = (bar("cases", self.cases), Mutex::new((found, Vec::new())));
        (0..self.cases).into_par_iter().try_for_each(|number| {
            let kind = Kind::of(number);
            let Verdict(outcome, words) = judge(program, &kind.make(self.seed, number, &files))?;
            let (found, faults) = &mut *heard.lock().unwrap_or_else(PoisonError::into_inner);
            found.cases.entry(kind.name().into()).or_default()[outcome as usize] += 1;
            if outcome > Outcome::Accepted {
                faults.push((number, outcome, words));
            }
            bar.add(1);
            Ok::<_, Error>(())
        })?;
        bar.finish();
        let (found, mut faults) = heard.into_inner().unwrap_or_else(PoisonError::into_inner);
        faults.sort_by_key(|(number, ..)| *number);
        for (k, (number, outcome, words)) in faults.into_iter().enumerate() {
            let (kind, outcome) = (Kind::of(number), outcome.name());
            found.faults.push(format!("case {number} ({}): {outcome}: {words}", kind.name()));
            if k < KEPT {
                let mut case = kind.make(self.seed, number, &files);
                case.files.retain(|name, bytes| files.get(name) != Some(bytes));
                case.files.insert("line.txt".into(), case.line.into());
                files::write(&self.faults.join(format!("{}-{}-{number}", kind.name(), outcome.replace(' ', "-"))), &case.files)?;
            }
        }
        Ok(())
    }
}

/// Good files, made with the program itself.
fn good(program: &Path) -> Result<files::Files> {
    let folder = files::scratch()?;
    files::build(program, folder.path())?;
    files::read(folder.path())
}

/// Tries the corpus: how many cases it has, and those that did not end as they should.
pub fn replay() -> Result<(usize, Vec<String>)> {
    let (program, entries) = (std::env::current_exe()?, corpus::entries()?);
    let files = good(&program)?;
    let wrong = entries.par_iter().map(|entry| Ok(entry.wrong(&judge(&program, &entry.case(&files)?)?)));
    Ok((entries.len(), wrong.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect()))
}
