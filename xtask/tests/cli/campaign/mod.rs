//! Hostile input. Good URDFs, specifications, tables, model folders, meshes and command lines are changed at random and
//! used. Each must be refused in words or used to the end. Faults are panics, aborts, more than 4 GiB or 10 s, numbers
//! that are not finite, and refusals that leave files. A mended fault becomes a case of `assets/corpus.toml`.
//! `NERD_CAMPAIGN=1000000` makes the campaign long.

mod case;
mod corpus;
mod files;
mod judge;
mod kills;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{LazyLock, Mutex};

use rayon::prelude::*;

use case::Kind;
use corpus::Entry;
use files::Files;
use judge::{Outcome, judge};

const SEED: u64 = 16;

fn program() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_xtask"))
}

/// Good files, made with the program itself.
static GOOD: LazyLock<Files> = LazyLock::new(|| {
    let folder = files::scratch();
    files::build(folder.path());
    files::read(folder.path())
});

#[test]
fn every_case_of_the_corpus_ends_as_it_should() {
    let entries = corpus::entries();
    let entries: Vec<_> =
        entries.iter().flat_map(|(kind, entries)| entries.iter().map(move |entry| (*kind, entry))).collect();
    let wrong = |(kind, (name, entry)): &(Kind, (&String, &Entry))| {
        Some(format!("{} {name}: {}", kind.name(), entry.wrong(*kind, &GOOD)?))
    };
    let wrong: Vec<String> = entries.par_iter().filter_map(wrong).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn changed_files_and_command_lines_are_refused_or_used() {
    let cases = std::env::var("NERD_CAMPAIGN").ok().and_then(|n| n.parse().ok()).unwrap_or(12_000);
    // By kind: refused, accepted.
    let (counts, faults) = (Mutex::new(BTreeMap::<&str, [u64; 2]>::new()), Mutex::new(Vec::new()));
    (0..cases).into_par_iter().for_each(|number| {
        let (kind, case) = (Kind::of(number), Kind::of(number).make(SEED, number, &GOOD));
        let column = match judge(&case) {
            Outcome::Refused(_) => 0,
            Outcome::Accepted => 1,
            Outcome::Fault(what, words) => {
                let changed = case
                    .files
                    .iter()
                    .find(|(name, bytes)| GOOD.get(*name) != Some(bytes))
                    .map(|(name, bytes)| (name, String::from_utf8_lossy(bytes)));
                return faults
                    .lock()
                    .expect("sound")
                    .push(format!("case {number}: {what}: {words}; `{}`, {changed:?}", case.line));
            }
        };
        counts.lock().expect("sound").entry(kind.name()).or_default()[column] += 1;
    });
    let (counts, faults) = (counts.into_inner().expect("sound"), faults.into_inner().expect("sound"));
    println!("refused, accepted: {counts:?}");
    assert!(faults.is_empty(), "{} faults: {}", faults.len(), faults.join("\n"));
    // A campaign that refuses everything tries nothing.
    for (kind, [refused, accepted]) in counts {
        assert!(accepted * 20 >= refused + accepted, "{kind}: fewer than a twentieth of the cases are accepted");
    }
}
