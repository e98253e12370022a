//! `cargo xtask campaign --cases 200000 --kinds mjcf --seed 3`: hostile input, tried by [`nerd_lab::campaign`].

use nerd_lab::campaign::Campaign;

use crate::{out::tables, prelude::*};

#[derive(clap::Args, Clone, Debug)]
pub struct CampaignArgs {
    #[command(flatten)]
    pub keys: Keys<Campaign>,
}

pub fn run(args: CampaignArgs) -> Result<()> {
    let campaign = args.keys.settings()?;
    let found = campaign.run()?;
    tables(&[found.table()]);
    found.lines(campaign.seed).iter().for_each(|fault| tell!("{fault}"));
    if found.faults.is_empty() { Ok(()) } else { bail!("{} faults", found.faults.len()) }
}
