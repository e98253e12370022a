//! A training run: updates, records, validation, checkpoints; stoppable and resumable at any update.
//!
//! In its folder a run keeps `metrics.jsonl`, `last.safetensors` (everything a continued run needs, see
//! [`crate::checkpoint`]) and `best.safetensors` (the averaged weights with the smallest criterion, as named tensors).
//! The criterion is the hook's value where it gives one, or else the validation loss. Resuming is: load
//! `last.safetensors`, make a learner of it, run the same [`TrainerConfig`] again.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_sim::range::within;
use serde::{Deserialize, Serialize};

use crate::checkpoint::{self, Best};
use crate::error::{Error, Result};
use crate::learner::Learner;
use crate::progress::bar_from;
use crate::ranks::{RankError, Ranks};
use crate::records::Record;
use crate::schedule::Schedule;
use crate::supply::Supply;

/// Length of a run and how often it does what. An interval of 0 means "only at the end".
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainerConfig {
    /// Updates in the whole run (paper: 999 x 5000).
    pub updates: u64,
    /// Learning rate.
    pub schedule: Schedule,
    /// Updates between validations (paper: 5000).
    pub validate_every: u64,
    /// Updates between full checkpoints (paper: 250 000); a run stopped in between loses what it did since.
    pub checkpoint_every: u64,
    /// Windows in a validation (paper: up to 100 batches of 512).
    pub validation_windows: usize,
    /// Updates between lines of the record. Each waits for the device.
    pub log_every: u64,
}

impl TrainerConfig {
    /// Refuses what no run can be made of.
    pub fn check(&self) -> Result<(), String> {
        within("updates", self.updates as f64, 1.0..=1e12, "")?;
        within("validation_windows", self.validation_windows as f64, 1.0..=1e9, "")?;
        self.schedule.check()
    }
}

impl Default for TrainerConfig {
    /// The paper's run.
    fn default() -> Self {
        Self {
            updates: 999 * 5000,
            schedule: Schedule::default(),
            validate_every: 5000,
            checkpoint_every: 250_000,
            validation_windows: 51_200,
            log_every: 500,
        }
    }
}

/// Called after each validation with the learner and the updates done. `Some(value)` becomes the criterion (smaller
/// is better), for example a rollout error; `None` leaves the validation loss.
pub type Hook<'a> = dyn FnMut(&mut dyn Learner, u64) -> Result<Option<f64>> + 'a;

/// A line of the record: means over the updates since the last such line, or one validation.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Line {
    Train { step: u64, loss: f32, gradient_norm: f32, lr: f64, windows_per_second: f64 },
    Validation { step: u64, loss: f32, criterion: f64, best: bool },
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Updates done.
    pub step: u64,
    /// Whether that is all of them (else the time was over).
    pub finished: bool,
    /// Step and criterion of `best.safetensors`; none before the first validation with a finite criterion.
    pub best: Option<(u64, f64)>,
}

/// Drives any learner through a run.
#[derive(Clone, Debug)]
pub struct Trainer {
    config: TrainerConfig,
    batch: usize,
    folder: PathBuf,
    run: String,
    stop_at: Option<Duration>,
    ranks: Arc<Ranks>,
}

impl Trainer {
    /// A run in `folder` (which exists) of updates of `batch` windows; `run` is JSON kept in its checkpoints.
    pub fn new(config: TrainerConfig, batch: usize, folder: &Path, run: &str) -> Self {
        Self { config, batch, folder: folder.into(), run: run.into(), stop_at: None, ranks: Arc::default() }
    }

    /// Trains as one of these ranks: rank 0 keeps the record, validates and writes, the others make its updates with it.
    pub fn among(mut self, ranks: &Arc<Ranks>) -> Self {
        self.ranks = ranks.clone();
        self
    }

    /// Stops, with a full checkpoint, at the first update that ends `wall` after [`Trainer::run`] was called.
    pub fn stop_at(mut self, wall: Option<Duration>) -> Self {
        self.stop_at = wall;
        self
    }

    /// Trains, on `fresh` data as it comes if there is any, from the learner's step to the configured number of updates or until the time
    /// is over.
    ///
    /// # Errors
    /// If an update, a validation or a file fails; the files of the last checkpoint stay as they are.
    pub fn run(&self, learner: &mut dyn Learner, mut fresh: Option<Supply>, hook: &mut Hook) -> Result<Outcome> {
        let (c, started) = (&self.config, Instant::now());
        c.check().map_err(Error::Refused)?;
        if !self.ranks.leads() {
            return self.follow(learner, fresh);
        }
        let first = learner.state()?.step;
        let mut metrics = Record::metrics(&self.folder, first)?;
        // A fresh run in an old folder starts its own comparison.
        let mut best = if first == 0 { None } else { self.best()?.map(|best| (best.step, best.criterion)) };
        let bar = bar_from("updates", first, c.updates);
        let (mut step, mut logged, mut since) = (first, first, Instant::now());
        while step < c.updates {
            let lr = self.update(learner, &mut fresh, step)?;
            step += 1;
            let over = self.over(started)?;
            if over || due(step, c.log_every, c.updates) {
                let p = learner.progress()?;
                let windows_per_second = (step - logged) as f64 * self.batch as f64 / since.elapsed().as_secs_f64();
                metrics.write(&Line::Train { step, loss: p.loss, gradient_norm: p.gradient_norm, lr, windows_per_second })?;
                bar.say(&format!("loss {:.3e}, {windows_per_second:.0} windows/s", p.loss));
                bar.set(step);
                (logged, since) = (step, Instant::now());
            }
            if due(step, c.validate_every, c.updates) {
                let paused = Instant::now();
                self.same(learner)?;
                let loss = learner.validate(c.validation_windows)?;
                let value = hook(learner, step)?;
                let criterion = value.unwrap_or(f64::from(loss));
                let better = criterion.is_finite() && best.is_none_or(|(_, b)| criterion < b);
                if better {
                    best = Some((step, criterion));
                    let state = learner.state()?;
                    Best { step, criterion, weights: state.averaged() }.save(&self.folder, &self.run)?;
                }
                metrics.write(&Line::Validation { step, loss, criterion, best: better })?;
                let star = if better { ", best so far" } else { "" };
                bar.line(&format!("step {step}: validation loss {loss:.4e}, criterion {criterion:.4e}{star}"));
                since += paused.elapsed();
            }
            if over || due(step, c.checkpoint_every, c.updates) {
                checkpoint::save(&checkpoint::last(&self.folder), &learner.state()?, &self.run)?;
            }
            if over {
                break;
            }
        }
        bar.finish();
        // What the last update was summed through is not taken away before all have it.
        self.ranks.wait()?;
        Ok(Outcome { step, finished: step >= c.updates, best })
    }

    /// The run of a rank that does not lead.
    fn follow(&self, learner: &mut dyn Learner, mut fresh: Option<Supply>) -> Result<Outcome> {
        let (c, started) = (&self.config, Instant::now());
        let mut step = learner.state()?.step;
        let mut over = false;
        while step < c.updates && !over {
            self.update(learner, &mut fresh, step)?;
            step += 1;
            over = self.over(started)?;
            if over || due(step, c.log_every, c.updates) {
                learner.progress()?;
            }
            if due(step, c.validate_every, c.updates) {
                self.same(learner)?;
            }
        }
        self.ranks.wait()?;
        Ok(Outcome { step, finished: step >= c.updates, best: None })
    }

    /// Update `step`, counted from 0, on fresh data where some is due before it; its learning rate.
    fn update(&self, learner: &mut dyn Learner, fresh: &mut Option<Supply>, step: u64) -> Result<f64> {
        while let Some(shard) = fresh.as_mut().and_then(|supply| supply.take(step)) {
            let (trajectory, windows) = shard?;
            learner.replace(trajectory, &windows)?;
        }
        let lr = self.config.schedule.rate(step, self.config.updates);
        learner.update(lr as f32)?;
        Ok(lr)
    }

    /// Whether the time is over, by the clock of rank 0.
    fn over(&self, started: Instant) -> Result<bool, RankError> {
        self.stop_at.map_or(Ok(false), |wall| self.ranks.decide(started.elapsed() >= wall))
    }

    /// Refuses to continue if ranks have different weights, which would go unnoticed.
    fn same(&self, learner: &mut dyn Learner) -> Result<()> {
        if self.ranks.world() == 1 {
            return Ok(());
        }
        let state = learner.state()?;
        let mine = format!("{} at update {}", checkpoint::hash(&state.weights), state.step);
        Ok(self.ranks.agree("weights", &mine, "ranks need machines, cards and programs of one kind")?)
    }

    /// The best weights so far, if there are any of this very run.
    ///
    /// # Errors
    /// If there is a file that cannot be read: it may hold a long run.
    pub fn best(&self) -> Result<Option<Best>> {
        Best::load(&self.folder, &self.run)
    }
}

/// Whether something done every `every` updates is done after update `step`; always after the last.
fn due(step: u64, every: u64, updates: u64) -> bool {
    step == updates || (every > 0 && step.is_multiple_of(every))
}
