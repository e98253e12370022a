//! `cargo xtask campaign --cases 1000000 --kills 500 --out results/campaign.md`: hostile input by the million.
//!
//! Good URDFs, specifications, tables, model folders and command lines are changed at random and used. Each must be refused in
//! words or be used to the end: no panic, no abort within 4 GB, nothing over 10 s, no number that is not finite. Runs that
//! are killed must leave no half a file and go on as if nothing had been. About 40 minutes for a million on two cores.
//! What fails is kept in `--faults`, and belongs into `xtask/tests/corpus` once it is mended.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Result, bail};

mod bench;
mod case;
mod child;
mod crew;
mod csv;
mod files;
mod kills;
mod line;
mod model;
mod mutate;
mod replay;
mod robots;
mod tally;
mod toml;
mod urdf;
mod worker;

use crate::provenance::Provenance;
use tally::Tally;

/// Faults that are written out, at most.
const KEPT: usize = 200;

/// Try hostile input.
#[derive(clap::Args, Clone, Debug)]
pub struct CampaignArgs {
    /// Cases in all, over the five kinds
    #[arg(long, default_value_t = 10_000)]
    pub cases: u64,
    /// Seed of what is changed
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Runs to kill at a random moment
    #[arg(long, default_value_t = 0)]
    pub kills: u64,
    /// Folder for the files of faults
    #[arg(long, default_value = "out/campaign")]
    pub faults: PathBuf,
    /// Markdown file to write the counts to
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Try the files of a corpus in place of mutated ones
    #[arg(long)]
    pub replay: Vec<PathBuf>,
    /// First case of a worker
    #[arg(long, hide = true)]
    pub first: Option<u64>,
    /// Its next one stands so much further
    #[arg(long, hide = true, default_value_t = 1)]
    pub stride: u64,
}

/// Runs the verb.
pub fn run(args: CampaignArgs) -> Result<()> {
    if !args.replay.is_empty() {
        return replay::replay(&args.replay);
    }
    if let Some(first) = args.first {
        return worker::work(args.seed, (first..args.cases).step_by(args.stride.max(1) as usize));
    }
    let scratch = tempfile::tempdir()?;
    let (tally, done) = (Mutex::new(Tally::default()), AtomicU64::new(0));
    let bar = crate::common::bar("cases", args.cases);
    crew::campaign(args.cases, args.seed, scratch.path(), &|number, verdict| {
        let Ok(mut tally) = tally.lock() else { return };
        tally.add(number, verdict);
        bar.say(&format!("{} faults", tally.found.len()));
        bar.set(done.fetch_add(1, Ordering::Relaxed) + 1);
    })?;
    bar.finish();
    let tally = tally.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    let kills = kills::kill(args.kills, args.seed)?;
    let tables = [(args.cases, tally.table()), (args.kills, kills.table())];
    let text = tables.into_iter().filter(|(n, _)| *n > 0).map(|(_, table)| table).collect::<Vec<_>>().join("\n");
    println!("{text}");
    let kept = tally.keep(args.seed, &args.faults, KEPT)?;
    if let Some(out) = &args.out {
        write(out, &text, &args)?;
    }
    let faults = tally.found.len() + kills.faults.len();
    for (number, (fault, words)) in tally.found.iter().take(20) {
        eprintln!("case {number} ({}): {}: {words}", case::Kind::of(*number).name(), fault.name());
    }
    kills.faults.iter().take(20).for_each(|words| eprintln!("{words}"));
    match faults {
        0 => Ok(()),
        n => bail!("{n} faults; files of {} stand in {}", kept.len(), args.faults.display()),
    }
}

/// The counts with their provenance.
fn write(out: &std::path::Path, text: &str, args: &CampaignArgs) -> Result<()> {
    let stamp = Provenance::now(args.seed);
    let from = format!("`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    let what = format!(
        "Good input changed at random, and used: refused in words, accepted, or a fault. Limits: {} s a case, {} GB a process.\n",
        child::SECONDS,
        child::MEMORY >> 30
    );
    crate::files::write(out, format!("# Hostile input\n\n{what}\n{text}\n{from}").as_bytes())
}
