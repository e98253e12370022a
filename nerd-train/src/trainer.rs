//! Training loop: updates, records, validation and checkpoints. A run can be stopped and resumed at any update.
//!
//! A run's folder holds `metrics.jsonl`, `last.safetensors` (the state to resume from, see [`crate::checkpoint`]) and
//! `best.safetensors` (the averaged weights with the smallest criterion, as named tensors). The criterion is the hook's
//! value, or else the validation loss. To resume: load `last.safetensors`, make a learner from the state, and run the
//! same [`TrainerConfig`].

use crate::checkpoint::{self, Best};
use crate::prelude::*;
use crate::progress::{Bar, bar_from};
use crate::records::Record;
use crate::schedule::Schedule;
use crate::stop::heed;
use crate::supply::Supply;

/// Length and intervals of a run. An interval of 0 means "only at the end".
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrainerConfig {
    /// Updates in the whole run (paper: 999 x 5000).
    pub updates: u64,
    /// Schedule of the learning rate.
    pub schedule: Schedule,
    /// Updates between validations (paper: 5000).
    pub validate_every: u64,
    /// Updates between checkpoints (paper: 250 000). A killed run loses the updates since its last checkpoint.
    pub checkpoint_every: u64,
    /// Windows in a validation (paper: up to 100 batches of 512).
    pub validation_windows: usize,
    /// Updates between training lines of `metrics.jsonl`. Each line waits for the device.
    pub log_every: u64,
}

impl TrainerConfig {
    /// Refuses settings outside their ranges.
    pub fn check(&self) -> Result<(), String> {
        within("updates", self.updates as f64, 1.0..=1e12, "")?;
        within("validation_windows", self.validation_windows as f64, 1.0..=1e9, "")?;
        self.schedule.check()
    }
}

/// Called after each validation with the learner and the number of updates done. `Some(value)` becomes the criterion
/// (smaller is better), for example a rollout error. With `None`, the validation loss is the criterion.
pub type Hook<'a> = dyn FnMut(&mut dyn Learner, u64) -> Result<Option<f64>> + 'a;

/// A line of `metrics.jsonl`: means over the updates since the last training line, or one validation. `risen` counts
/// the validations since the smallest loss, if the loss rises.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Line {
    Train { step: u64, loss: f32, gradient_norm: f32, learning_rate: f64, windows_per_second: f64 },
    Validation { step: u64, loss: f32, criterion: f64, best: bool, risen: Option<usize> },
}

/// A rise of the validation loss counts from this many validations after the smallest loss on. The loss must exceed
/// this multiple of the smallest.
const RISE: (usize, f32) = (3, 1.02);

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Number of updates done, earlier sessions included.
    pub step: u64,
    /// Whether all updates are done; if not, time ran out or a signal came.
    pub finished: bool,
    /// Step and criterion of `best.safetensors`; none before the first finite criterion.
    pub best: Option<(u64, f64)>,
}

/// Runs any learner through a training run.
#[derive(Clone, Debug)]
pub struct Trainer {
    config: TrainerConfig,
    batch: usize,
    folder: PathBuf,
    run: String,
    /// Time limit, counted from the call of [`Trainer::run`]. After it, or a signal ([`crate::stop`]), the run stops
    /// with a checkpoint at the next update.
    pub stop_at: Option<Duration>,
}

struct Lead {
    metrics: Record,
    bar: Bar,
    best: Option<(u64, f64)>,
    losses: Vec<(u64, f32)>,
    /// Update and time of the last training line; the time excludes validations.
    logged: (u64, Instant),
}

impl Trainer {
    /// A run in the existing `folder`, with `batch` windows per update. `run` is JSON stored in its checkpoints.
    pub fn new(config: TrainerConfig, batch: usize, folder: &Path, run: &str) -> Self {
        Self { config, batch, folder: folder.into(), run: run.into(), stop_at: None }
    }

    /// Trains from the learner's step to the configured number of updates, or until time runs out. Shards of `fresh`
    /// replace windows before the updates at which they are due.
    ///
    /// # Errors
    /// If an update, a validation or a file fails. The last checkpoint stays as it was.
    pub fn run(&self, learner: &mut dyn Learner, mut fresh: Option<Supply>, hook: &mut Hook) -> Result<Outcome> {
        let c = &self.config;
        let started = Instant::now();
        c.check()?;
        let mut step = learner.state()?.step;
        let mut over = false;
        let mut lead = self.lead(step)?;
        let _heed = heed();
        let stop = Stop(self.stop_at.and_then(|wall| started.checked_add(wall)));
        while step < c.updates && !over {
            let learning_rate = self.update(learner, &mut fresh, step)?;
            step += 1;
            over = stop.due();
            if over || due(step, c.log_every, c.updates) {
                lead.log(step, learner.progress()?, learning_rate, self.batch)?;
            }
            if due(step, c.validate_every, c.updates) {
                self.validate(&mut lead, learner, step, hook)?;
            }
            if over || due(step, c.checkpoint_every, c.updates) {
                checkpoint::save(&checkpoint::last(&self.folder), &learner.state()?, &self.run)?;
            }
        }
        lead.bar.finish();
        Ok(Outcome { step, finished: step >= c.updates, best: lead.best })
    }

    fn lead(&self, first: u64) -> Result<Lead> {
        let metrics = Record::metrics(&self.folder, first)?;
        // A run from update 0 ignores the best weights that an earlier run left in the folder.
        let best = if first == 0 { None } else { self.best()?.map(|best| (best.step, best.criterion)) };
        let losses = validations(&self.folder);
        Ok(Lead {
            metrics,
            bar: bar_from("updates", first, self.config.updates),
            best,
            losses,
            logged: (first, Instant::now()),
        })
    }

    fn validate(&self, lead: &mut Lead, learner: &mut dyn Learner, step: u64, hook: &mut Hook) -> Result<()> {
        let paused = Instant::now();
        let loss = learner.validate(self.config.validation_windows)?;
        let criterion = hook(learner, step)?.unwrap_or(f64::from(loss));
        let better = criterion.is_finite() && lead.best.is_none_or(|(_, b)| criterion < b);
        if better {
            lead.best = Some((step, criterion));
            Best { step, criterion, weights: learner.state()?.averaged() }.save(&self.folder, &self.run)?;
        }
        lead.losses.extend(loss.is_finite().then_some((step, loss)));
        let risen = rise(&lead.losses);
        lead.metrics.write(&Line::Validation {
            step,
            loss,
            criterion,
            best: better,
            risen: risen.map(|(count, _)| count),
        })?;
        let star = if better { ", best so far" } else { "" };
        lead.bar.line(&format!("step {step}: validation loss {loss:.4e}, criterion {criterion:.4e}{star}"));
        if let Some((count, (first, least))) = risen {
            lead.bar.line(&format!(
                "validation loss rises: its least, {least:.4e} at step {first}, was {count} validations ago; more data helps against overfitting"
            ));
        }
        lead.logged.1 += paused.elapsed();
        Ok(())
    }

    /// Takes the fresh data due before update `step`, counted from 0, then makes the update. Returns its learning rate.
    fn update(&self, learner: &mut dyn Learner, fresh: &mut Option<Supply>, step: u64) -> Result<f64> {
        while let Some(shard) = fresh.as_mut().and_then(|supply| supply.take(step)) {
            let (trajectory, windows) = shard?;
            learner.replace(trajectory, &windows)?;
        }
        let learning_rate = self.config.schedule.rate(step, self.config.updates);
        learner.update(learning_rate as f32)?;
        Ok(learning_rate)
    }

    /// The best weights of this run so far, if there are any.
    ///
    /// # Errors
    /// If the file exists and cannot be read: it may hold a long run's result.
    pub fn best(&self) -> Result<Option<Best>> {
        Best::load(&self.folder, &self.run)
    }
}

impl Lead {
    fn log(
        &mut self,
        step: u64,
        Progress { loss, gradient_norm }: Progress,
        learning_rate: f64,
        batch: usize,
    ) -> Result<()> {
        let (first, since) = self.logged;
        let windows_per_second = (step - first) as f64 * batch as f64 / since.elapsed().as_secs_f64();
        self.metrics.write(&Line::Train { step, loss, gradient_norm, learning_rate, windows_per_second })?;
        self.bar.say(&format!("loss {loss:.3e}, {windows_per_second:.0} windows/s"));
        self.bar.set(step);
        self.logged = (step, Instant::now());
        Ok(())
    }
}

/// Step and loss of each validation in the `metrics.jsonl` of a folder.
fn validations(folder: &Path) -> Vec<(u64, f32)> {
    let text = nerd_sim::files::read_record(&folder.join("metrics.jsonl")).unwrap_or_default();
    let lines = text.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let validation = |line: serde_json::Value| {
        Some((line["step"].as_u64()?, line["loss"].as_f64()? as f32)).filter(|_| line["kind"] == "validation")
    };
    lines.filter_map(validation).collect()
}

/// Validations since the smallest loss, with its step and value, if the loss has risen beyond noise ([`RISE`]) and
/// still rises.
fn rise(losses: &[(u64, f32)]) -> Option<(usize, (u64, f32))> {
    let (least, best) = losses.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    let [.., before, last] = losses else { return None };
    let count = losses.len() - 1 - least;
    (count >= RISE.0 && last.1 > before.1 && last.1 > RISE.1 * best.1).then_some((count, *best))
}

/// Whether an action with interval `every` is due after update `step`; always after the last update.
fn due(step: u64, every: u64, updates: u64) -> bool {
    step == updates || (every > 0 && step.is_multiple_of(every))
}
