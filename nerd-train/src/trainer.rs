//! A training run: updates, records, validation, checkpoints; stoppable and resumable at any update.
//!
//! In its folder a run keeps `metrics.jsonl`, `last.safetensors` (everything a continued run needs, see
//! [`crate::checkpoint`]) and `best.safetensors` (the averaged weights with the smallest criterion, as named tensors).
//! The criterion is the hook's value where it gives one, or else the validation loss. Resuming is: load
//! `last.safetensors`, make a learner of it, run the same [`TrainerConfig`] again.

use crate::checkpoint::{self, Best};
use crate::prelude::*;
use crate::progress::{Bar, bar_from};
use crate::records::Record;
use crate::schedule::Schedule;
use crate::stop::heed;
use crate::supply::Supply;

/// Length of a run and how often it does what. An interval of 0 means "only at the end".
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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

/// Called after each validation with the learner and the updates done. `Some(value)` becomes the criterion (smaller
/// is better), for example a rollout error; `None` leaves the validation loss.
pub type Hook<'a> = dyn FnMut(&mut dyn Learner, u64) -> Result<Option<f64>> + 'a;

/// A line of the record: means over the updates since the last such line, or one validation; `risen`: validations since the least loss, where
/// it rises.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Line {
    Train { step: u64, loss: f32, gradient_norm: f32, lr: f64, windows_per_second: f64 },
    Validation { step: u64, loss: f32, criterion: f64, best: bool, risen: Option<usize> },
}

/// Validations beyond the least loss, and how far above it the loss has to be, before a rise is more than noise.
const RISE: (usize, f32) = (3, 1.02);

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
    /// Stops, with a full checkpoint, at the first update that ends so long after [`Trainer::run`] was called, as it does once the process is
    /// asked to ([`crate::stop`]).
    pub stop_at: Option<Duration>,
}

struct Lead {
    metrics: Record,
    bar: Bar,
    best: Option<(u64, f64)>,
    losses: Vec<(u64, f32)>,
    /// The update that the last line of training was of, and when it was written, but for time spent on validations.
    logged: (u64, Instant),
}

impl Trainer {
    /// A run in `folder` (which exists) of updates of `batch` windows; `run` is JSON kept in its checkpoints.
    pub fn new(config: TrainerConfig, batch: usize, folder: &Path, run: &str) -> Self {
        Self { config, batch, folder: folder.into(), run: run.into(), stop_at: None }
    }

    /// Trains, on `fresh` data as it comes if there is any, from the learner's step to the configured number of updates or until the time
    /// is over.
    ///
    /// # Errors
    /// If an update, a validation or a file fails; the files of the last checkpoint stay as they are.
    pub fn run(&self, learner: &mut dyn Learner, mut fresh: Option<Supply>, hook: &mut Hook) -> Result<Outcome> {
        let (c, started) = (&self.config, Instant::now());
        c.check().map_err(Error::Refused)?;
        let (mut step, mut over) = (learner.state()?.step, false);
        let mut lead = self.lead(step)?;
        let (_heed, stop) = (heed(), Stop(self.stop_at.and_then(|wall| started.checked_add(wall))));
        while step < c.updates && !over {
            let lr = self.update(learner, &mut fresh, step)?;
            step += 1;
            over = stop.due();
            if over || due(step, c.log_every, c.updates) {
                lead.log(step, learner.progress()?, lr, self.batch)?;
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
        // A fresh run in an old folder starts its own comparison.
        let best = if first == 0 { None } else { self.best()?.map(|best| (best.step, best.criterion)) };
        let losses = validations(&self.folder);
        Ok(Lead { metrics, bar: bar_from("updates", first, self.config.updates), best, losses, logged: (first, Instant::now()) })
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
        lead.metrics.write(&Line::Validation { step, loss, criterion, best: better, risen: risen.map(|(count, _)| count) })?;
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

    /// The best weights so far, if there are any of this very run.
    ///
    /// # Errors
    /// If there is a file that cannot be read: it may hold a long run.
    pub fn best(&self) -> Result<Option<Best>> {
        Best::load(&self.folder, &self.run)
    }
}

impl Lead {
    fn log(&mut self, step: u64, Progress { loss, gradient_norm }: Progress, lr: f64, batch: usize) -> Result<()> {
        let (first, since) = self.logged;
        let windows_per_second = (step - first) as f64 * batch as f64 / since.elapsed().as_secs_f64();
        self.metrics.write(&Line::Train { step, loss, gradient_norm, lr, windows_per_second })?;
        self.bar.say(&format!("loss {loss:.3e}, {windows_per_second:.0} windows/s"));
        self.bar.set(step);
        self.logged = (step, Instant::now());
        Ok(())
    }
}

/// Step and loss of the validations on record in a run's folder.
fn validations(folder: &Path) -> Vec<(u64, f32)> {
    let text = nerd_sim::files::read_record(&folder.join("metrics.jsonl")).unwrap_or_default();
    let lines = text.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let validation =
        |line: serde_json::Value| Some((line["step"].as_u64()?, line["loss"].as_f64()? as f32)).filter(|_| line["kind"] == "validation");
    lines.filter_map(validation).collect()
}

/// How many validations ago the loss was least, and that one, if it is more than noise above it and still rises.
fn rise(losses: &[(u64, f32)]) -> Option<(usize, (u64, f32))> {
    let (least, best) = losses.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    let [.., before, last] = losses else { return None };
    let count = losses.len() - 1 - least;
    (count >= RISE.0 && last.1 > before.1 && last.1 > RISE.1 * best.1).then_some((count, *best))
}

/// Whether something done every `every` updates is done after update `step`; always after the last.
fn due(step: u64, every: u64, updates: u64) -> bool {
    step == updates || (every > 0 && step.is_multiple_of(every))
}
