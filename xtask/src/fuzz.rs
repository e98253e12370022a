//! `cargo xtask fuzz --cases 200000 --kinds mjcf --seed 3`: fuzzes the readers of files with
//! [`nerd_lab::campaign`].

use nerd_cli::out::tables;
use nerd_lab::campaign::Campaign;

use crate::prelude::*;

pub fn run(keys: Keys<Campaign>) -> Result<()> {
    let campaign = keys.settings()?;
    let found = campaign.run()?;
    tables(&[found.table()]);
    found.lines(campaign.seed).iter().for_each(|fault| tell!("{fault}"));
    if found.faults.is_empty() { Ok(()) } else { bail!("{} faults", found.faults.len()) }
}
