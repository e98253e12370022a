//! `cargo xtask campaign --cases 1000000 --kills 500 --out results`: hostile input by the million, tried by [`nerd_lab::campaign`].
//! About 40 minutes for a million on two cores.

use std::path::PathBuf;

use anyhow::{Result, bail};
use nerd_lab::campaign::{Campaign, Program, Rollout, Source};
use nerd_lab::experiments::{Experiment, conduct};

use crate::solvers::SolverArgs;

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
    #[arg(long, value_name = "FOLDER", default_value = "out/campaign")]
    pub faults: PathBuf,
    /// Folder to write the counts into, as campaign.json and campaign.md
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Try the files of a corpus in place of changed ones
    #[arg(long, value_name = "FOLDER")]
    pub replay: Vec<PathBuf>,
    /// First case of a worker, and how much further its next one stands
    #[arg(long, hide = true, value_delimiter = ',')]
    pub work: Option<Vec<u64>>,
}

/// Runs the verb.
pub fn run(args: CampaignArgs) -> Result<()> {
    let program = Program { path: std::env::current_exe()?, rollout };
    let CampaignArgs { cases, seed, kills, faults: kept, .. } = args;
    if let Some([first, stride]) = args.work.as_deref() {
        return Ok(nerd_lab::campaign::work(program, &Source { seed, cases, corpus: args.replay }, *first, *stride)?);
    }
    if !args.replay.is_empty() {
        nerd_lab::campaign::replay(&program, &args.replay)?.iter().for_each(|line| println!("{line}"));
        return Ok(());
    }
    let campaign = Campaign { program, seed, cases, kills, kept };
    let found = match &args.out {
        Some(out) => conduct(&campaign, out)?.data,
        None => campaign.measure()?,
    };
    crate::out::tables(&campaign.tables(&found)?);
    found.faults.iter().take(20).for_each(|words| eprintln!("{words}"));
    match found.faults.len() {
        0 => Ok(()),
        n => bail!("{n} faults; files of the first stand in {}", campaign.kept.display()),
    }
}

/// The verb `rollout`, without a process of its own.
fn rollout(job: &Rollout) -> Result<(), String> {
    let (robot, scene, states, out) = (job.robot.into(), job.scene.into(), job.states.into(), job.out.into());
    let args = crate::rollout::RolloutArgs { robot, scene, solver: SolverArgs::default(), states, frames: None, out };
    crate::rollout::run(args).map_err(|e| format!("{e:#}"))
}
