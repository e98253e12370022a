//! Ranks: several processes of one run, on one machine or on many. `torchrun`, `srun`, `mpirun` or a shell loop starts them with the variables of
//! [`Place`], and ends those that wait for a lost one. A single process is rank 0 of 1, at no cost.
//!
//! Each rank computes its share of every update, gradients are summed in rank order, and every rank makes the same step: weights are
//! equal everywhere and never sent. Rank 0 leads: it evaluates, decides and writes while the others wait. Sums and bytes go by TCP to and from
//! rank 0 (`star.rs`), gradients on GPUs by NCCL (`nerd_cuda::Sums`).

mod place;
mod star;

use std::net::TcpStream;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use crate::prelude::*;
pub use place::{Place, RankError, bytes, floats};

/// This process among those of its run.
#[derive(Debug, Default)]
pub struct Ranks {
    place: Place,
    /// Connections: of rank 0 to all others, of any other to rank 0.
    ties: Vec<(usize, TcpStream)>,
    /// The first rank that was lost, and its reason.
    lost: OnceLock<(usize, String)>,
    parted: AtomicBool,
}

impl Ranks {
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

    /// [`Self::sum`] of a gradient and the loss that goes with it, so that all ranks stop where that is not a number.
    pub fn sum_with(&self, gradient: &mut Vec<f32>, loss: f32) -> Result<f32, RankError> {
        if self.ties.is_empty() {
            return Ok(loss);
        }
        gradient.push(loss);
        self.sum(gradient)?;
        Ok(gradient.pop().unwrap_or(f32::NAN))
    }

    /// Waits until all ranks have come to this point.
    pub fn wait(&self) -> Result<(), RankError> {
        self.sum(&mut [])
    }

    /// Whether rank 0 says yes.
    pub fn decide(&self, mine: bool) -> Result<bool, RankError> {
        Ok(self.share(0, || vec![mine.into()])? == [1])
    }

    /// Refuses to go on where `mine` is not what rank 0 has: in what, and what to do, is said.
    pub fn agree(&self, what: &str, mine: &str, advice: &str) -> Result<(), RankError> {
        let theirs = String::from_utf8_lossy(&self.share(0, || mine.into())?).into_owned();
        if theirs == mine {
            return self.wait();
        }
        let (rank, apart) = (self.place.rank, between(&theirs, mine));
        Err(RankError(format!("rank {rank}: {what} differ from those of rank 0: {apart}; {advice}")))
    }
}

impl Drop for Ranks {
    fn drop(&mut self) {
        self.leave(Some("it went away before the end"));
    }
}
