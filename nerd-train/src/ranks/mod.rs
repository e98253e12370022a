//! Ranks: several processes of one run, on one machine or on many.
//!
//! Each rank computes its share of every update, gradients are summed in rank order, and every rank makes the same step: weights are
//! equal everywhere and never sent. Rank 0 leads: it evaluates, decides and writes while the others wait. A single process is rank 0 of
//! 1, at no cost.
//!
//! ```text
//! place.rs   which rank this is: RANK, WORLD_SIZE, LOCAL_RANK, MASTER_ADDR, MASTER_PORT
//! star.rs    how ranks meet: all connect to rank 0 by TCP, which carries sums and bytes
//! ```
//!
//! On GPUs gradients go by NCCL (`nerd_cuda::Sums`). Processes are started by `torchrun`, `srun`, `mpirun` or a shell loop that sets their
//! variables; the launcher also ends those that wait for a lost one.

mod place;
mod star;

use std::ops::Range;

pub use place::{Place, RankError, bytes, floats};
use star::Star;

use crate::difference::between;

/// This process among those of its run.
#[derive(Debug, Default)]
pub struct Ranks {
    place: Place,
    star: Option<Star>,
}

impl Ranks {
    /// Meets the others; waits for them up to a minute.
    pub fn join(place: Place) -> Result<Self, RankError> {
        let star = if place.world > 1 { Some(Star::join(&place)?) } else { None };
        Ok(Self { place, star })
    }

    /// Its number, from 0.
    pub fn rank(&self) -> usize {
        self.place.rank
    }

    /// How many there are.
    pub fn world(&self) -> usize {
        self.place.world
    }

    /// Its number on its machine, from 0: that of its graphics card.
    pub fn local(&self) -> usize {
        self.place.local
    }

    /// Whether it evaluates, decides and writes.
    pub fn leads(&self) -> bool {
        self.place.rank == 0
    }

    /// Its share of `0..n`: shares follow one another and differ by one at most.
    pub fn part(&self, n: usize) -> Range<usize> {
        let Place { rank, world, .. } = self.place;
        rank * n / world..(rank + 1) * n / world
    }

    /// Adds up the vectors of all ranks, in rank order, so that all have the same bits after it.
    pub fn sum(&self, values: &mut [f32]) -> Result<(), RankError> {
        self.star.as_ref().map_or(Ok(()), |star| star.sum(values))
    }

    /// The same of a gradient and the loss that goes with it, so that all ranks stop where that is not a number.
    pub fn sum_with(&self, gradient: &mut Vec<f32>, loss: f32) -> Result<f32, RankError> {
        if self.star.is_none() {
            return Ok(loss);
        }
        gradient.push(loss);
        self.sum(gradient)?;
        Ok(gradient.pop().unwrap_or(f32::NAN))
    }

    /// What rank `from` has, on all ranks; only there is `make` called.
    pub fn share(&self, from: usize, make: impl FnOnce() -> Vec<u8>) -> Result<Vec<u8>, RankError> {
        let mine = (from == self.place.rank).then(make);
        match &self.star {
            None => Ok(mine.unwrap_or_default()),
            Some(star) => star.share(from, mine),
        }
    }

    /// What all ranks have, in their order, on rank 0; nothing on the others.
    pub fn gather(&self, mine: Vec<u8>) -> Result<Vec<Vec<u8>>, RankError> {
        match &self.star {
            None => Ok(vec![mine]),
            Some(star) => star.gather(mine),
        }
    }

    /// Waits until all ranks have come to this point.
    pub fn wait(&self) -> Result<(), RankError> {
        self.sum(&mut [])
    }

    /// Whether rank 0 says yes.
    pub fn decide(&self, mine: bool) -> Result<bool, RankError> {
        if self.star.is_none() {
            return Ok(mine);
        }
        Ok(self.share(0, || vec![mine.into()])? == [1])
    }

    /// Refuses to go on where `mine` is not what rank 0 has: in what, and what to do, is said.
    pub fn agree(&self, what: &str, mine: &str, advice: &str) -> Result<(), RankError> {
        if self.star.is_none() {
            return Ok(());
        }
        let theirs = String::from_utf8_lossy(&self.share(0, || mine.into())?).into_owned();
        if theirs == mine {
            return self.wait();
        }
        let (rank, apart) = (self.place.rank, between(&theirs, mine));
        Err(RankError(format!("rank {rank}: {what} differ from those of rank 0: {apart}; {advice}")))
    }

    /// Parts from the others: done, or for a reason that they will tell. Once is enough.
    pub fn leave(&self, reason: Option<&str>) {
        if let Some(star) = &self.star {
            star.leave(reason);
        }
    }
}

impl Drop for Ranks {
    fn drop(&mut self) {
        self.leave(Some("it went away before the end"));
    }
}
