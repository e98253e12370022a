//! `cargo xtask train`: a run, or a recipe of several.

use std::path::PathBuf;

use anyhow::{Result, bail};
use nerd_train::run::{Recipe, RunConfig};

use crate::options::{Keys, Whole, value};
use crate::ranks;

/// Train a NeRD model.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// File of settings (TOML): the keys are those of the options below, which go before what it says
    #[arg(conflicts_with = "recipe")]
    pub file: Option<PathBuf>,
    /// Settings that come with the project: `paper` (E 192, 6 layers, batch 512: the defaults), `small` (E 48, 2 layers, batch
    /// 128), `quick` (small, with what training has learned since), `urdf` (that, longer, for a robot of one's own), `chain` (for a cable on a gripper, rod by rod), `chain-large` (that, wider, for a graphics card), `baseline`, or those of a model in `models/`, which is
    /// trained again, all of its runs (--updates and --transitions are then most that each has)
    #[arg(long)]
    pub recipe: Option<String>,
    /// Processes of this machine that share the run out among them [default: 1, or WORLD_SIZE where a launcher set it]
    #[arg(long, value_name = "N", conflicts_with = "gpus", value_parser = value::<usize>(Whole(1..=1024)))]
    pub ranks: Option<usize>,
    /// As many ranks, each with a graphics card of its own: `--ranks N --device cuda`
    #[arg(long, value_name = "N", value_parser = value::<usize>(Whole(1..=1024)))]
    pub gpus: Option<usize>,
    #[command(flatten)]
    pub keys: Keys<RunConfig>,
}

/// Runs the verb.
pub fn run(args: TrainArgs) -> Result<()> {
    let mut given = args.keys.given;
    if args.gpus.is_some() && given.insert("device".into(), "cuda".into()).is_some_and(|device| device != "cuda") {
        bail!("--gpus: a rank with a graphics card computes there; leave --device out");
    }
    let recipe = match (&args.file, &args.recipe) {
        (Some(file), _) => Recipe::read(file, &given),
        (None, Some(name)) => Recipe::named(name, &given),
        (None, None) => Recipe::plain(&given),
    }?;
    ranks::run(args.ranks.or(args.gpus), |ranks| Ok(recipe.train_among(ranks).map(drop)?))
}
