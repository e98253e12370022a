//! `cargo xtask campaign --cases 1000000 --kills 500 --out results`: hostile input by the million, tried by [`nerd_lab::campaign`].

use std::path::PathBuf;

use anyhow::{Result, bail};
use nerd_lab::campaign::{Call, Campaign, Found, replay, work};
use nerd_lab::experiments::{Experiment, conduct};

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
    /// Folder to write the counts into
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Try the corpus of faults that were found once, in place of changed input
    #[arg(long)]
    pub replay: bool,
    /// Order of a worker
    #[arg(long, hide = true, value_delimiter = ',')]
    pub work: Option<Vec<String>>,
}

/// Runs the verb; `call` runs the others.
pub fn run(args: CampaignArgs, call: Call) -> Result<()> {
    if let Some(order) = &args.work {
        return work(call, order);
    }
    let program = std::env::current_exe()?;
    if args.replay {
        let (tried, wrong) = replay(&program, call)?;
        if !wrong.is_empty() {
            bail!("{} of {tried} cases: {}", wrong.len(), wrong.join("; "));
        }
        say!("{tried} cases ended as they should");
        return Ok(());
    }
    let CampaignArgs { cases, seed, kills, faults: kept, .. } = args;
    let campaign = Campaign { program, seed, cases, kills, kept };
    let (data, tables) = match &args.out {
        Some(out) => conduct(&campaign, out).map(|result| (result.data, result.tables))?,
        None => campaign.measure().map(|measured| (measured.data, measured.tables))?,
    };
    crate::out::tables(&tables);
    let found: Found = serde_json::from_value(data.into())?;
    found.faults.iter().take(20).for_each(|words| tell!("{words}"));
    match found.faults.len() {
        0 => Ok(()),
        n => bail!("{n} faults; files of the first are in {}", campaign.kept.display()),
    }
}
