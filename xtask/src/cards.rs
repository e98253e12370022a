//! `cargo xtask cards`: several graphics cards against one (`nerd_lab::experiments::cards`, with the feature `cuda`).

use std::path::PathBuf;

use anyhow::Result;

use crate::numbers::{SEEDS, count};

/// Several graphics cards against one: how much faster they learn, and that they learn the same (needs a build with `--features cuda`).
/// Each card is a rank that a launcher starts.
#[derive(clap::Args, Clone, Debug)]
#[cfg_attr(not(feature = "cuda"), allow(dead_code))]
pub struct CardsArgs {
    /// Task that policies learn
    #[arg(long, default_value = "ant-run")]
    pub task: String,
    /// Seed of weights, noise and starts
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder for cards.json and .md [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
#[cfg(feature = "cuda")]
pub fn run(args: CardsArgs) -> Result<()> {
    use nerd_lab::experiments::Experiment;

    crate::ranks::run(|ranks| {
        let experiment = nerd_lab::experiments::cards::Cards { ranks: ranks.clone(), task: args.task, seed: args.seed };
        if ranks.leads() {
            return crate::out::conduct(&experiment, &args.out.unwrap_or_else(nerd_train::shipped::results));
        }
        Ok(experiment.measure().map(drop)?)
    })
}

/// Says what it takes.
#[cfg(not(feature = "cuda"))]
pub fn run(_: CardsArgs) -> Result<()> {
    anyhow::bail!("this needs a build with `--features cuda`: cargo run --release -p xtask --features cuda -- cards")
}
