//! `cargo xtask campaign --cases 1000000 --kills 500 --out results/campaign.md`: hostile input by the million, tried by
//! [`nerd_campaign`]. About 40 minutes for a million on two cores.

use std::path::PathBuf;

use anyhow::{Result, bail};
use nerd_campaign::{MEMORY, Program, Rollout, SECONDS, Source};

use crate::provenance::Provenance;
use crate::solvers::SolverArgs;
use crate::table::markdown;

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
    /// First case of a worker, and how much further its next one stands
    #[arg(long, hide = true, value_delimiter = ',')]
    pub work: Option<Vec<u64>>,
}

/// Runs the verb.
pub fn run(args: CampaignArgs) -> Result<()> {
    let program = Program { path: std::env::current_exe()?, rollout };
    if let Some([first, stride]) = args.work.as_deref() {
        let source = match args.replay.is_empty() {
            true => Source::Seed { seed: args.seed, cases: args.cases },
            false => Source::corpus(&args.replay)?,
        };
        return Ok(nerd_campaign::work(program, &source, *first, *stride)?);
    }
    if !args.replay.is_empty() {
        nerd_campaign::replay(&program, &args.replay)?.iter().for_each(|line| println!("{line}"));
        return Ok(());
    }
    let bar = crate::common::bar("cases", args.cases + args.kills);
    let found = nerd_campaign::campaign(&program, (args.seed, args.cases, args.kills), &args.faults, &|what, done, faults| {
        bar.say(&format!("{faults} faults"));
        bar.set(if what == "kills" { args.cases + done } else { done });
    })?;
    bar.finish();
    let text = found.tables.iter().map(|t| markdown(&t.header, &t.rows)).collect::<Vec<_>>().join("\n");
    println!("{text}");
    if let Some(out) = &args.out {
        let stamp = Provenance::now(args.seed);
        let from = format!("`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
        let what = "Good input changed at random, and used: refused in words, accepted, or a fault.";
        let limits = format!("Limits: {SECONDS} s a case, {} GB a process.\n", MEMORY >> 30);
        crate::files::write(out, format!("# Hostile input\n\n{what} {limits}\n{text}\n{from}").as_bytes())?;
    }
    found.faults.iter().take(20).for_each(|words| eprintln!("{words}"));
    match found.faults.len() {
        0 => Ok(()),
        n => bail!("{n} faults; files of {} stand in {}", found.kept.len(), args.faults.display()),
    }
}

/// The verb `rollout`, without a process of its own.
fn rollout(job: &Rollout) -> Result<(), String> {
    let (robot, scene, states, out) = (job.robot.into(), job.scene.into(), job.states.into(), job.out.into());
    let args = crate::rollout::RolloutArgs { robot, scene, solver: SolverArgs::default(), states, steps: None, out };
    crate::rollout::run(args).map_err(|e| format!("{e:#}"))
}
