//! Verbs that may be shared out among ranks: processes that a launcher (`torchrun`, `srun`, `mpirun`, a loop in a shell) starts.

use std::sync::Arc;

use anyhow::{Result, ensure};
use nerd_train::progress;
use nerd_train::ranks::{Place, Ranks};

use crate::refusals::failure;

/// Does the work as one of the ranks, of which this process may be the only one.
pub fn run(work: impl FnOnce(&Arc<Ranks>) -> Result<()>) -> Result<()> {
    let place = Place::here()?;
    if place.rank > 0 {
        progress::quiet();
    }
    let ranks = Arc::new(Ranks::join(place)?);
    let done = work(&ranks);
    ranks.leave(done.as_ref().err().map(failure).as_deref());
    done
}

/// Refuses to be one of several ranks, each of which would do the same.
pub fn alone(verb: &str, instead: &str) -> Result<()> {
    let world = Place::here()?.world;
    ensure!(world == 1, "WORLD_SIZE is {world}: {verb} runs as one process; {instead}");
    Ok(())
}
