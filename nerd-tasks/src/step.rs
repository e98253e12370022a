//! What a step of many environments gives, and how they are looked after side by side.

use nerd_sim::prelude::*;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{View, Work};

/// Environments that one thread looks after in a row.
pub(crate) const CHUNK: usize = 32;

/// What a step gave, by environment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepResult {
    /// Rewards.
    pub rewards: Vec<f64>,
    /// What they are made of, `[env][`[`crate::Task::terms`]`]`; 0 where the solver could not go on.
    pub terms: Vec<f64>,
    /// Episodes that ended in a terminal state.
    pub terminated: Vec<bool>,
    /// Episodes that ran out of time. The state they were in has a value yet: see `reached`.
    pub truncated: Vec<bool>,
    /// Observations `[env][observation_dim]` of the states reached, before ended episodes restarted.
    pub reached: Vec<f64>,
    /// [`crate::Task::miss`] of the states reached; none of one that the solver could not go on with.
    pub misses: Vec<Option<f64>>,
    /// Episodes that the solver could not go on with (a state not finite, or beyond 1e5): terminated, with reward 0.
    pub failed: Vec<bool>,
}

/// What an environment, by its number among all, draws from in its present episode, as many of which have begun.
pub(crate) fn episode(seed: u64, env: usize, begun: u64) -> ChaCha8Rng {
    stream(seed, (env as u64) << 32 | (begun - 1))
}

/// Writes a row of `width` numbers for every environment.
pub(crate) fn rows(all: &mut [f64], width: usize, works: &mut [Work], write: impl Fn(usize, &mut [f64], &mut Work) + Sync) {
    let width = width.max(1);
    let chunks = all.par_chunks_mut(CHUNK * width).zip(works).enumerate();
    chunks.for_each(|(chunk, (rows, work))| {
        rows.chunks_exact_mut(width).enumerate().for_each(|(i, row)| write(chunk * CHUNK + i, row, work));
    });
}

pub(crate) fn view<'a>(batch: &'a Batch, goals: &'a [f64], width: usize, env: usize) -> View<'a> {
    View { state: batch.state(env), goal: &goals[env * width..(env + 1) * width], scene: &batch.scenes[env] }
}
