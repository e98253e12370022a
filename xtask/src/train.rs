//! `cargo xtask train`: a run, or a recipe of several.

use nerd_train::run::{Recipe, RunConfig};

use crate::prelude::*;

#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// File of settings (TOML), whose keys are the options below; options override it
    #[arg(conflicts_with = "recipe")]
    pub file: Option<PathBuf>,
    /// Settings that come with the project: `paper` (E 192, 6 layers, batch 512: the defaults), `small` (E 48, 2 layers, batch
    /// 128), `quick` (small, with later improvements), `urdf` (the same, longer, for your own robot), `chain` (for a cable on a gripper, rod by rod), `chain-large` (that, wider, for a graphics card), or those of a model in `models/`, which is
    /// trained again, all of its runs (--updates and --transitions are then most that each has)
    #[arg(long)]
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
