//! `cargo xtask policy co-train TASKS`: policies and model in turn ([`nerd_lab::cotrain`]).

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use nerd_lab::cotrain::{CoTrainConfig, co_train};
use nerd_train::settings::Settings;

use crate::keys::Keys;
use crate::out::tables;

/// Train policies and their model in turn.
#[derive(clap::Args, Clone, Debug)]
pub struct CoTrainArgs {
    /// Tasks, all of one robot
    #[arg(required = true, value_name = "TASK")]
    pub tasks: Vec<String>,
    #[command(flatten)]
    pub keys: Keys<CoTrainConfig>,
    /// Folder of the loop [default: out/co-train-ROBOT]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: CoTrainArgs) -> Result<()> {
    let config = CoTrainConfig::default().with(&args.keys.given).map_err(|e| anyhow!(e))?;
    let done = co_train(args.tasks, config, args.out)?;
    tables(&[done.table]);
    println!("{}", done.said);
    Ok(())
}
