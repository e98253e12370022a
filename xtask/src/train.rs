//! `cargo xtask train`: a run, or a recipe of several.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Result, bail};
use nerd_train::progress;
use nerd_train::ranks::{self, End, Place, RankError, Ranks};
use nerd_train::run::{Recipe, RunConfig};

use crate::keys::Keys;
use crate::numbers::count;
use crate::refusals::failure;

/// Train a NeRD model.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// File of settings (TOML): the keys are those of the options below, which go before what it says
    #[arg(conflicts_with = "recipe")]
    pub file: Option<PathBuf>,
    /// Settings that come with the project: `paper` (E 192, 6 layers, batch 512: the defaults), `small` (E 48, 2 layers, batch
    /// 128), `quick` (small, with what training has learned since), `urdf` (that, longer, for a robot of one's own), `chain` (for a cable on a gripper, rod by rod), `baseline`, or those of a model in `models/`, which is
    /// trained again, all of its runs (--updates and --transitions are then most that each has)
    #[arg(long)]
    pub recipe: Option<String>,
    /// Processes of this machine that share the run out among them [default: 1, or WORLD_SIZE where a launcher set it]
    #[arg(long, value_name = "N", conflicts_with = "gpus", value_parser = count::<usize>(1..=1024))]
    pub ranks: Option<usize>,
    /// As many ranks, each with a graphics card of its own: `--ranks N --device cuda`
    #[arg(long, value_name = "N", value_parser = count::<usize>(1..=1024))]
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
    let place = Place::here()?;
    match args.ranks.or(args.gpus) {
        Some(asked) if place.world > 1 && asked != place.world => {
            bail!("--ranks {asked}: a launcher started {} of them (WORLD_SIZE); leave one of both out", place.world)
        }
        Some(asked) if place.world == 1 && asked > 1 => started(asked),
        _ => among(recipe, place),
    }
}

/// Starts all ranks.
fn started(world: usize) -> Result<()> {
    match ranks::launch(world)? {
        End::Well => Ok(()),
        End::Said => std::process::exit(2),
        End::Ill(reason) => bail!(reason),
    }
}

/// Trains as one of them.
fn among(recipe: Recipe, place: Place) -> Result<()> {
    ranks::with_launcher();
    if place.rank > 0 {
        progress::quiet();
    }
    let ranks = Arc::new(Ranks::join(place, end)?);
    let done = recipe.train_among(&ranks).map_err(anyhow::Error::from);
    ranks.leave(done.as_ref().err().map(failure).as_deref());
    done.map(drop)
}

/// Ends a rank that cannot hear that another one is lost.
fn end(error: &RankError) {
    progress::last(format_args!("error: {error}"));
    std::process::exit(2);
}
