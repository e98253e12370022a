//! Results of a step of many environments, and parallel loops over environments.

use nerd_sim::prelude::*;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{View, Work};

/// Number of environments that one thread handles at a time.
pub(crate) const CHUNK: usize = 32;

/// Results of a step, per environment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepResult {
    /// Rewards, `[env]`.
    pub rewards: Vec<f64>,
    /// Terms of the rewards, `[env][`[`crate::Task::terms`]`]`; 0 where the solver failed.
    pub terms: Vec<f64>,
    /// Whether the episode terminated, `[env]`.
    pub terminated: Vec<bool>,
    /// Whether the episode was truncated at its length, `[env]`. The final state (see `reached`) of a truncated episode
    /// still has a value.
    pub truncated: Vec<bool>,
    /// Observations `[env][observation_dim]` of the states reached, before ended episodes restarted.
    pub reached: Vec<f64>,
    /// [`crate::Task::error`] of the states reached, `[env]`; `None` where the solver failed.
    pub errors: Vec<Option<f64>>,
    /// Whether the solver failed (a state not finite, or beyond 1e5), `[env]`. The episode is then terminated, with
    /// reward 0.
    pub failed: Vec<bool>,
}

/// Random stream of an environment's present episode. `env` is the environment's index in the whole set, `begun` the
/// number of episodes begun in it.
pub(crate) fn episode(seed: u64, env: usize, begun: u64) -> ChaCha8Rng {
    stream(seed, (env as u64) << 32 | (begun - 1))
}

/// Writes a row of `width` numbers for every environment, in parallel.
pub(crate) fn rows(
    all: &mut [f64],
    width: usize,
    works: &mut [Work],
    write: impl Fn(usize, &mut [f64], &mut Work) + Sync,
) {
    let width = width.max(1);
    let chunks = all.par_chunks_mut(CHUNK * width).zip(works).enumerate();
    chunks.for_each(|(chunk, (rows, work))| {
        rows.chunks_exact_mut(width).enumerate().for_each(|(i, row)| write(chunk * CHUNK + i, row, work));
    });
}

pub(crate) fn view<'a>(batch: &'a Batch, goals: &'a [f64], width: usize, env: usize) -> View<'a> {
    View { state: batch.state(env), goal: &goals[env * width..(env + 1) * width], scene: &batch.scenes[env] }
}
