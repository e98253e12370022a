//! Updates on the CPU, with the batch cut into shards.
//!
//! Each shard computes `sum (y - y*)^2 / (batch tokens outputs)` or its pseudo-Huber form, so shards add up to loss and
//! gradient of the batch. Shards keep all cores busy, and the activations of a small shard stay in the cache. Gradients
//! are added in shard order, so the result does not depend on the number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::optimiser::{self, Optimiser};
use crate::prelude::*;
use crate::windows::draw;

/// Windows in a shard, unless set by [`Sharded::shards`].
const SHARD: usize = 32;
/// Gradient entries that one task sums over the shards.
const SUM: usize = 1 << 14;

/// Computes errors and gradients of a shard.
pub trait Pass: Sync {
    type Worker;
    /// A network with these weights; without `gradients`, it computes errors alone.
    fn worker(&self, weights: &Weights, gradients: bool) -> Self::Worker;
    /// Takes the worker back when its thread ends.
    fn rest(&self, _: Self::Worker) {}
    /// Sum of the squared errors over a shard.
    fn squares(&self, worker: &mut Self::Worker, shard: Shard) -> LearnResult<f64>;
    /// Sum of the squared errors over a shard, and gradient of the loss ([`LearnerConfig::huber`]), both times `scale`.
    fn gradient(
        &self,
        worker: &mut Self::Worker,
        shard: Shard,
        scale: f64,
        huber: Option<f32>,
    ) -> LearnResult<(f64, Vec<f32>)>;
}

pub struct Shard {
    pub windows: usize,
    pub tokens: usize,
    /// Tokens `[windows][tokens][inputs]`.
    pub x: Vec<f32>,
    /// Targets `[windows][tokens][outputs]`.
    pub y: Vec<f32>,
}

/// Trains with shards of a [`Pass`]. The optimiser runs on the CPU, on the flat vectors of [`LearnerState`].
pub struct Sharded<P> {
    pass: P,
    optimiser: Optimiser,
    train: Arc<Windows>,
    validation: Arc<Windows>,
    shard: usize,
    threads: usize,
}

impl<P: Pass> Sharded<P> {
    pub(super) fn with(
        pass: P,
        config: LearnerConfig,
        state: LearnerState,
        sets: [Arc<Windows>; 2],
    ) -> LearnResult<Self> {
        super::check(&config, &state, [&sets[0], &sets[1]])?;
        let optimiser = Optimiser::new(config, state, optimiser::BETA);
        let threads = rayon::current_num_threads();
        let [train, validation] = sets;
        Ok(Self { pass, optimiser, train, validation, shard: SHARD, threads })
    }

    /// Sets the shard size and the number of threads. On a GPU, set one shard for the whole batch and one thread.
    pub fn shards(mut self, windows: usize, threads: usize) -> Self {
        (self.shard, self.threads) = (windows.max(1), threads.max(1));
        self
    }

    /// Squared error, and gradient of the loss before clipping, over the training windows `rows`.
    pub fn gradient(&self, rows: &[u64]) -> LearnResult<(f32, Vec<f32>)> {
        let scale = 1.0 / values(&self.train, rows.len());
        let huber = self.optimiser.config.huber;
        let work =
            |worker: &mut P::Worker, rows: &[u64]| self.pass.gradient(worker, shard(&self.train, rows), scale, huber);
        let parts = self.sharded(&self.optimiser.state.weights, true, rows, work)?;
        let loss = parts.iter().map(|(loss, _)| loss).sum::<f64>() as f32;
        let mut parts = parts.into_iter().map(|(_, gradient)| gradient);
        let mut total = parts.next().unwrap_or_default();
        let rest = parts.collect_vec();
        let sums = total.par_chunks_mut(SUM).enumerate();
        sums.for_each(|(i, total)| rest.iter().for_each(|part| add(total, &part[i * SUM..])));
        Ok((loss, total))
    }

    /// Runs `work` on every shard of `rows` on several threads. Results are in shard order.
    ///
    /// Plain threads, not rayon tasks: burn waits inside its locks, and a waiting rayon thread might start another
    /// shard there. Each thread has its own network, so that autodiff graphs share nothing.
    fn sharded<T: Send>(
        &self,
        weights: &Weights,
        gradients: bool,
        rows: &[u64],
        work: impl Fn(&mut P::Worker, &[u64]) -> LearnResult<T> + Sync,
    ) -> LearnResult<Vec<T>> {
        let shards = rows.chunks(self.shard).collect_vec();
        let next = AtomicUsize::new(0);
        let thread = || {
            let mut worker = self.pass.worker(weights, gradients);
            let mut done = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(rows) = shards.get(i) else {
                    self.pass.rest(worker);
                    return Ok::<_, LearnError>(done);
                };
                done.push((i, work(&mut worker, rows)?));
            }
        };
        let mut done = std::thread::scope(|scope| -> LearnResult<Vec<(usize, T)>> {
            // If a thread cannot be started, the others do its work.
            let other = |_| std::thread::Builder::new().spawn_scoped(scope, thread).ok();
            let others = (1..self.threads.min(shards.len())).map_while(other).collect_vec();
            let mut done = thread()?;
            for other in others {
                done.extend(other.join().map_err(|_| LearnError::Device("a worker thread panicked".into()))??);
            }
            Ok(done)
        })?;
        done.sort_unstable_by_key(|(i, _)| *i);
        Ok(done.into_iter().map(|(_, result)| result).collect())
    }
}

impl<P: Pass> Learner for Sharded<P> {
    fn update(&mut self, lr: f32) -> LearnResult {
        let step = self.optimiser.state.step;
        let windows = self.train.len() as u64;
        let LearnerConfig { batch, seed, .. } = self.optimiser.config;
        let rows = (0..batch as u64).map(|row| draw(seed, step, row, windows)).collect_vec();
        let (loss, gradient) = self.gradient(&rows)?;
        self.optimiser.update(lr, loss, &gradient)
    }

    fn replace(&mut self, first: usize, fresh: &Windows) -> LearnResult {
        Arc::make_mut(&mut self.train).replace(first, fresh).map_err(LearnError::Mismatch)
    }

    fn progress(&mut self) -> LearnResult<Progress> {
        Ok(self.optimiser.progress())
    }

    fn validate(&mut self, windows: usize) -> LearnResult<f32> {
        let rows = validation_rows(self.validation.len(), windows);
        let weights = self.optimiser.state.averaged();
        let work = |worker: &mut P::Worker, rows: &[u64]| self.pass.squares(worker, shard(&self.validation, rows));
        let parts = self.sharded(&weights, false, &rows, work)?;
        Ok((parts.iter().sum::<f64>() / values(&self.validation, rows.len())) as f32)
    }

    fn state(&mut self) -> LearnResult<LearnerState> {
        Ok(self.optimiser.state.clone())
    }
}

/// Number of squared errors in a mean over `windows` windows.
fn values(set: &Windows, windows: usize) -> f64 {
    (windows * set.history * set.outputs) as f64
}

fn shard(set: &Windows, rows: &[u64]) -> Shard {
    let gather = |data: &[f32], width: usize| {
        let window = |&row: &u64| &data[set.first_token(row as usize) * width..][..set.history * width];
        rows.iter().flat_map(window).copied().collect()
    };
    Shard { windows: rows.len(), tokens: set.history, x: gather(&set.x, set.inputs), y: gather(&set.y, set.outputs) }
}
