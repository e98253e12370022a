//! A policy's training in a folder: PPO in an arena, resumable, with the record, the curve and the best policy it came to.
//!
//! The folder holds `metrics.jsonl`, `sessions.jsonl`, `last.safetensors` and, drawn at the end, `curve.svg` and `curve.png`
//! (feature `report`); the same run again continues it. The policy with the largest mean reward is in `OUT/policy`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_sim::prelude::*;
use nerd_tasks::{Fast, Task, named};

use super::clock::{Clock, Split};
use super::{Arena, PpoConfig, Shared, Trainer, card};
use crate::bounds;
use crate::difference::between;
use crate::error::{Error, Result, refuse};
use crate::progress::{Bar, bar};
use crate::ranks::Ranks;
use crate::records::{Record, Session, claimed};

/// Two checkpoints are at least this far apart.
const SAVE: Duration = Duration::from_secs(60);

/// One run.
#[derive(Clone, Debug)]
pub struct PolicyRun {
    /// Its task.
    pub task: String,
    /// Where it learns.
    pub arena: Arena,
    /// How.
    pub config: PpoConfig,
    /// Seed of weights, noise and starts.
    pub seed: u64,
    /// Whether episodes begin fast ([`nerd_tasks::Fast`]).
    pub fast: bool,
    /// Stops once the mean reward of the last episodes has reached this.
    pub until: Option<f64>,
    /// Stops, with a checkpoint, after so many minutes.
    pub minutes: Option<f64>,
    /// Folder of the run.
    pub out: PathBuf,
}

/// What a run came to so far.
#[derive(Clone, Debug)]
pub struct Learned {
    /// Task and solver.
    pub title: String,
    /// Folder of the policy.
    pub policy: PathBuf,
    /// Its mean reward; none before a full set of episodes has ended.
    pub reward: Option<f64>,
    /// Iterations done.
    pub iterations: u64,
    /// Episodes that ended because the solver could not go on with them, this time.
    pub failed: usize,
    /// Time of this call.
    pub elapsed: Duration,
    /// What it was spent on, in words.
    pub spent: String,
}

/// A run that goes on.
struct Going {
    trainer: Trainer<Shared>,
    metrics: Option<Record>,
    split: Split,
    failed: usize,
}

impl PolicyRun {
    /// Trains, or goes on training.
    ///
    /// # Errors
    /// If task, model or settings cannot be, the folder is another run's or in use, the solver cannot step, or a file cannot be
    /// written.
    pub fn train(&self) -> Result<Learned> {
        self.lead(&Arc::default())
    }

    /// The same as one of several ranks: each steps its share of the environments. On CPUs rank 0 learns, on cards every rank does; rank 0
    /// writes. None on the others.
    ///
    /// # Errors
    /// As [`PolicyRun::train`]; or if another rank is lost.
    pub fn train_among(&self, ranks: &Arc<Ranks>) -> Result<Option<Learned>> {
        let (environments, world) = (self.config.environments, ranks.world());
        if world > environments {
            refuse!("{environments} environments: {world} ranks need one each");
        }
        if self.arena.on_gpu() && world > 1 {
            return self.side_by_side(ranks);
        }
        if ranks.leads() {
            return self.lead(ranks).map(Some);
        }
        let system = System::named(named(&self.task)?.robot())?;
        self.shared(ranks, &system, &Clock::default())?.serve()?;
        Ok(None)
    }

    /// On cards every rank learns, each from its share of the environments; rank 0 writes.
    fn side_by_side(&self, ranks: &Arc<Ranks>) -> Result<Option<Learned>> {
        #[cfg(feature = "cuda")]
        nerd_cuda::take(ranks.local()).map_err(|e| Error::Refused(format!("--device cuda: {e}")))?;
        Some(self.lead(ranks)).filter(|done| ranks.leads() || done.is_err()).transpose()
    }

    /// This rank's share of the environments.
    fn shared(&self, ranks: &Arc<Ranks>, system: &Arc<System>, clock: &Clock) -> Result<Shared> {
        let identity = serde_json::json!({ "run": self.identity(system)?, "seed": self.seed, "settings": self.config }).to_string();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let how = |theirs: &[u8], ours: &[u8]| between(&text(theirs), &text(ours)) + "; give all ranks the same command";
        ranks.agree("settings", identity.as_bytes(), how)?;
        let (task, n) = (named(&self.task)?, self.config.environments);
        let task = if self.fast { Box::new(Fast::new(task, system)) } else { task };
        let (part, own) = (ranks.part(n), self.arena.part(task, ranks.part(n), self.seed, clock)?);
        // Where every rank learns, none tells another what to do.
        Ok(if self.arena.on_gpu() { Shared::new(own, part.len(), &Arc::default())? } else { Shared::new(own, n, ranks)? })
    }

    /// What a checkpoint is known by: a model is its weights, wherever they are.
    fn identity(&self, system: &System) -> Result<String> {
        let begun = if self.fast { " from fast starts" } else { "" };
        Ok(format!("{}{begun} on {}", self.task, self.arena.identity(system)?))
    }

    fn lead(&self, ranks: &Arc<Ranks>) -> Result<Learned> {
        let (started, out) = (Instant::now(), &self.out);
        let task = named(&self.task)?;
        self.config.check()?;
        memory(&*task, &self.config)?;
        let (system, solver) = (System::named(task.robot())?, self.arena.title()?);
        let title = format!("{} on {solver}", self.task);
        let (identity, clock) = (self.identity(&system)?, Clock::default());
        let episodes = self.shared(ranks, &system, &clock)?;
        let learners = if self.arena.on_gpu() { ranks.clone() } else { Arc::default() };
        let mut trainer = Trainer::among(&learners, episodes, self.config.clone(), self.seed)?;
        #[cfg(feature = "cuda")]
        if self.arena.on_gpu() {
            let engine = super::CudaEngine::among(&trainer.state.policy.shape, &self.config, &learners);
            trainer.engine = Box::new(engine.map_err(|e| Error::Refused(format!("--device cuda: {e}")))?);
        }
        let leads = learners.leads();
        let _claim = leads.then(|| claimed(out)).transpose()?;
        if out.join(LAST).exists() {
            let other = |e| Error::Refused(format!("{} holds another run; choose another --out: {e}", out.display()));
            trainer.resume(&out.join(LAST), &identity).map_err(other)?;
            if leads {
                eprintln!("going on at iteration {} of {}", trainer.state.iteration, trainer.config.iterations);
            }
        }
        let at = [trainer.state.iteration.to_le_bytes().to_vec(), crate::ranks::bytes(&trainer.state.policy.flat)].concat();
        learners.agree("checkpoint", &at, |_, _| "give all ranks the same --out, in a folder that all of them see".into())?;
        // Nobody reads any more what the first will write.
        learners.wait()?;
        let first = trainer.state.iteration;
        let metrics = leads.then(|| Record::metrics(out, first)).transpose()?;
        let bar = bar(&format!("steps of {title}"), trainer.config.iterations * trainer.config.steps() as u64);
        let mut going = Going { trainer, metrics, split: Split::default(), failed: 0 };
        self.iterate(&mut going, &identity, started, &bar)?;
        bar.finish();
        let Going { trainer, split, failed, .. } = going;
        trainer.environments.end()?;
        let spent = split.words(&clock);
        let (_, reward) = trainer.best();
        let (policy, iterations, elapsed) = (out.join("policy"), trainer.state.iteration, started.elapsed());
        let done = Learned { title, policy, reward, iterations, failed, elapsed, spent };
        if !leads {
            return Ok(done);
        }
        // Asked again, a finished run keeps its times.
        if trainer.state.iteration > first || !Session::any(out) {
            Session::log(out, first, trainer.state.iteration, done.elapsed.as_secs_f64(), &done.spent)?;
        }
        card::export(out, &self.task, (&solver, &identity), &trainer)?;
        Ok(done)
    }

    /// Iterations until all are done, the reward is reached or time is over; ends with a checkpoint.
    fn iterate(&self, going: &mut Going, identity: &str, started: Instant, bar: &Bar) -> Result<()> {
        let Going { trainer, metrics, split, failed } = going;
        let (checkpoint, mut saved) = (self.out.join(LAST), Instant::now());
        while trainer.state.iteration < trainer.config.iterations {
            let line = trainer.iterate()?;
            metrics.as_mut().map_or(Ok(()), |metrics| metrics.write(&line))?;
            split.add(&line, trainer.config.steps());
            *failed += line.failed;
            if let (Some(reward), Some(length)) = (line.reward, line.length) {
                bar.say(&format!("iteration {}: mean reward {reward:.1} over {length:.0} steps", line.step));
            }
            bar.set(line.frames);
            let reached = self.until.zip(line.reward).is_some_and(|(wanted, reward)| reward >= wanted && trainer.state.best.is_some());
            let late = self.minutes.is_some_and(|m| started.elapsed().as_secs_f64() > 60.0 * m);
            if trainer.ranks.decide(reached || late)? {
                break;
            }
            if trainer.ranks.decide(saved.elapsed() > SAVE)? {
                trainer.save(&checkpoint, identity)?;
                saved = Instant::now();
            }
        }
        Ok(trainer.save(&checkpoint, identity)?)
    }
}

/// The state to go on from.
const LAST: &str = "last.safetensors";

impl PpoConfig {
    /// Settings of a task: of a file, those called `small` or `paper`, or by what a step in the arena costs.
    ///
    /// # Errors
    /// If the file cannot be read or has a key that there is not, or there is no such task.
    pub fn choose(task: &str, arena: &Arena, recipe: Option<&str>, file: Option<&std::path::Path>) -> Result<Self> {
        if let Some(path) = file {
            let text = nerd_sim::files::read_text(path).map_err(Error::file(path))?;
            return Self::from_text(&text).map_err(Error::format(path));
        }
        Ok(match recipe {
            Some("small") => Self::small(task)?,
            None if arena.dear() => Self::small(task)?,
            _ => Self::of(task)?,
        })
    }
}

/// Refuses a run whose steps of one iteration do not fit in memory.
fn memory(task: &dyn Task, config: &PpoConfig) -> Result<()> {
    let seen = task.observation_dim() * config.stack;
    // Observations, and as inputs; actions, means and spreads, twice; rewards, values, advantages and the like.
    let a_step = 12 * seen + 24 * task.action_dim() + 100;
    bounds::memory(&[("`environments`", config.environments), ("`horizon`", config.horizon)], a_step)
}
