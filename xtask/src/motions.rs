//! `cargo xtask motions`: how far solvers err along motions that none has seen ([`nerd_lab::experiments::motions`]), and one of them to look at.

use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::experiments::Experiment;
use nerd_lab::experiments::motions::Motions;

use crate::conduct::ConductArgs;

/// Measure how far solvers and models err along motions that none has seen.
#[derive(clap::Args, Clone, Debug)]
pub struct MotionsArgs {
    #[command(flatten)]
    pub measure: ConductArgs<Motions>,
    /// File that replays the first motion in the first model and in its truth: a page, or of FILE.svg a picture with FILE.png beside it (needs --model)
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: MotionsArgs) -> Result<()> {
    let settings = args.measure.settings()?;
    let replay = args.replay.map(|file| Ok::<_, anyhow::Error>((file, settings.replay()?))).transpose()?;
    args.measure.run()?;
    replay.map_or(Ok(()), |(file, replay)| crate::files::replay(&file, &replay, settings.seed()))
}
