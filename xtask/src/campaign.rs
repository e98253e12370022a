//! `cargo xtask campaign --cases 1000000 --kills 500 --out results`: hostile input by the million, tried by [`nerd_lab::campaign`].

use nerd_lab::campaign::{Campaign, Found, replay};
use nerd_lab::experiments::{Experiment, conduct};

use crate::prelude::*;

#[derive(clap::Args, Clone, Debug)]
pub struct CampaignArgs {
    #[command(flatten)]
    pub keys: Keys<Campaign>,
    /// Folder to write the counts into
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Try the corpus of faults that were found once, in place of changed input
    #[arg(long)]
    pub replay: bool,
}

pub fn run(args: CampaignArgs) -> Result<()> {
    if args.replay {
        let (tried, wrong) = replay()?;
        if !wrong.is_empty() {
            bail!("{} of {tried} cases: {}", wrong.len(), wrong.join("; "));
        }
        say!("{tried} cases ended as they should");
        return Ok(());
    }
    let campaign = args.keys.settings()?;
    let (data, tables) = match &args.out {
        Some(out) => conduct(&campaign, out).map(|result| (result.data, result.tables))?,
        None => campaign.measure().map(|measured| (measured.data, measured.tables))?,
    };
    crate::out::tables(&tables);
    let found: Found = serde_json::from_value(data.into())?;
    found.faults.iter().take(20).for_each(|words| tell!("{words}"));
    match found.faults.len() {
        0 => Ok(()),
        n => bail!("{n} faults; files of the first are in {}", campaign.faults.display()),
    }
}
