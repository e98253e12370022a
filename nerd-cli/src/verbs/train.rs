//! `cargo xtask train`: trains a model in one run, or in the several runs of a recipe.

use nerd_train::run::{Recipe, RunConfig};

use crate::prelude::*;

#[derive(clap::Args)]
pub struct TrainArgs {
    /// TOML file of settings, with the options below as keys. Options on the command line override it
    #[arg(conflicts_with = "recipe")]
    pub file: Option<PathBuf>,
    /// Shipped settings. For any robot: `paper` (the defaults), `small` (width 48, 2 layers), `quick` (width 64, single
    /// frames) or `urdf` (longer `quick`). For a cable on a gripper: `chain`, or `chain-large` for a GPU. The name of a
    /// model in `models/` trains it again, in all of its runs. With several runs, --updates and --transitions are upper
    /// bounds for each run [default: paper, unless FILE is given]
    #[arg(long, value_name = "NAME", help_heading = "Run")]
    pub recipe: Option<String>,
    #[command(flatten)]
    pub keys: Keys<RunConfig>,
}

pub fn run(args: TrainArgs) -> Result<()> {
    let given = args.keys.given;
    let recipe = match (&args.file, &args.recipe) {
        (Some(file), _) => Recipe::read(file, &given),
        (None, Some(name)) => Recipe::named(name, &given),
        (None, None) => Recipe::plain(&given),
    }?;
    Ok(recipe.train().map(drop)?)
}
