//! Verbs that may be shared out among ranks: started here, or by a launcher that sets their variables.

use std::sync::Arc;

use anyhow::{Result, bail, ensure};
use nerd_train::progress;
use nerd_train::ranks::{self, End, Place, RankError, Ranks};

use crate::refusals::failure;

/// Does the work as one of the ranks; or starts as many as are asked for, each of which comes here again.
pub fn run(asked: Option<usize>, work: impl FnOnce(&Arc<Ranks>) -> Result<()>) -> Result<()> {
    let place = Place::here()?;
    match asked {
        Some(asked) if place.world > 1 && asked != place.world => {
            bail!("--ranks {asked}: a launcher started {} of them (WORLD_SIZE); leave one of both out", place.world)
        }
        Some(asked) if place.world == 1 && asked > 1 => started(asked),
        _ => among(place, work),
    }
}

/// Refuses to be one of several ranks, each of which would do the same.
pub fn alone(verb: &str, instead: &str) -> Result<()> {
    let world = Place::here()?.world;
    ensure!(world == 1, "WORLD_SIZE is {world}: {verb} runs as one process; {instead}");
    Ok(())
}

fn started(world: usize) -> Result<()> {
    match ranks::launch(world)? {
        End::Well => Ok(()),
        End::Said => std::process::exit(2),
        End::Ill(reason) => bail!(reason),
    }
}

fn among(place: Place, work: impl FnOnce(&Arc<Ranks>) -> Result<()>) -> Result<()> {
    ranks::with_launcher();
    if place.rank > 0 {
        progress::quiet();
    }
    let ranks = Arc::new(Ranks::join(place, end)?);
    let done = work(&ranks);
    ranks.leave(done.as_ref().err().map(failure).as_deref());
    done
}

/// Ends a rank that cannot hear that another one is lost.
fn end(error: &RankError) {
    progress::last(format_args!("error: {error}"));
    std::process::exit(2);
}
