//! Training of a policy in a folder: resumable, with metrics, learning curve and the best policy.
//!
//! The folder holds `metrics.jsonl`, `sessions.jsonl` and `last.safetensors`; starting the same run again continues it.
//! `OUT/policy` holds the policy with the largest mean return.

use nerd_tasks::Work;

use super::export::export;
use super::*;
use crate::progress::{bar_from, notes};
use crate::records::{Record, Session, claimed, ours};
use crate::stop::{PATIENCE, heed};
use crate::{bounds, files};

/// Least time between two checkpoints, unless iterations are long.
const SAVE: Duration = Duration::from_secs(60);

/// Training of a policy in a folder.
#[derive(Clone)]
pub struct PolicyRun {
    /// Task, by its name or the path of its file.
    pub task: String,
    /// Solver that the policy trains in.
    pub arena: Arena,
    /// Training settings.
    pub config: PpoConfig,
    /// Seed of weights, noise and starts.
    pub seed: u64,
    /// Time after which the run stops and writes a checkpoint (min); `None`: no limit.
    pub minutes: Option<f64>,
    /// Folder of the run.
    pub out: PathBuf,
}

/// A run's results so far.
#[derive(Clone, Debug)]
pub struct Learned {
    /// Names of task and solver.
    pub title: String,
    /// Folder of the policy.
    pub policy: PathBuf,
    /// Mean return of the policy; `None` before enough episodes have ended.
    pub reward: Option<f64>,
    /// Iterations done.
    pub iterations: u64,
    /// Episodes ended by a solver failure in this call.
    pub failed: usize,
    /// Reason of the first solver failure, if known.
    pub fault: Option<String>,
    /// Wall time of this call.
    pub elapsed: Duration,
    /// Environment steps per second; `None` if no iteration was left to do.
    pub rate: Option<f64>,
    /// Steps per second and each stage's share of the time (%), as text.
    pub spent: String,
}

impl PolicyRun {
    /// Trains the policy, or continues the run that the folder holds.
    pub fn train(&self) -> Result<Learned> {
        let started = Instant::now();
        let out = &self.out;
        let task = named(&self.task)?;
        self.config.check()?;
        let system = task.system()?;
        let solver = self.arena.title()?;
        bearable(&*task, &system, &self.config)?;
        let title = format!("{} on {solver}", self.task);
        // A checkpoint identifies a model by its weights, not by its path.
        let identity = format!("{} on {}", folder::identity(&*task), self.arena.identity(&system)?);
        let mut trainer = self.arena.trainer(task, self.config.clone(), self.seed)?;
        begun(&trainer.episodes)?;
        notes(&system);
        ours(out)?;
        let _claim = claimed(out)?;
        if out.join(LAST).exists() {
            let other = |e| Error::Refused(format!("{} holds another run; choose another --out: {e}", out.display()));
            trainer.resume(&out.join(LAST), &identity).map_err(other)?;
            tell!("going on at iteration {} of {}", trainer.state.iteration, trainer.config.iterations);
        }
        let first = trainer.state.iteration;
        let _heed = heed();
        trainer.stop = Stop::after(started, self.minutes);
        let spent = self.iterate(&mut trainer, &title, &identity)?;
        let (_, reward) = trainer.best();
        let policy = out.join("policy");
        let iterations = trainer.state.iteration;
        let elapsed = started.elapsed();
        let fault = trainer.episodes.fault.clone();
        let done = Learned {
            title,
            policy,
            reward,
            iterations,
            failed: spent.failed,
            fault,
            elapsed,
            rate: spent.rate(),
            spent: spent.words(),
        };
        // A finished run that is started again logs no session, so that its times stay.
        if iterations > first || !Session::any(out) {
            Session::log(out, first, iterations, elapsed.as_secs_f64(), &done.spent)?;
        }
        export(out, &solver, &identity, &trainer)?;
        Ok(done)
    }

    /// Iterates until all iterations are done or time is up, then writes a checkpoint. If an iteration is interrupted,
    /// the last checkpoint remains.
    fn iterate(&self, trainer: &mut Trainer, title: &str, identity: &str) -> Result<Spent> {
        let checkpoint = self.out.join(LAST);
        let mut saved = Instant::now();
        // The metrics file is opened after the first iteration, so that a run refused in it leaves no file.
        let mut metrics = None;
        let mut spent = Spent::default();
        let steps = trainer.config.steps();
        let [done, all] = [trainer.state.iteration, trainer.config.iterations].map(|n| n * steps as u64);
        let bar = bar_from(&format!("steps of {title}"), done, all);
        let mut last = (trainer.state.iteration, Duration::ZERO);
        while trainer.state.iteration < trainer.config.iterations {
            if trainer.state.iteration > last.0 && (saved.elapsed() > SAVE || last.1 > PATIENCE) {
                trainer.save(&checkpoint, identity)?;
                (saved, last.0) = (Instant::now(), trainer.state.iteration);
            }
            let begun = Instant::now();
            let line = match trainer.iterate() {
                Err(Error::Stopped) if trainer.state.iteration > 0 => return Ok(spent),
                Err(Error::Stopped) => refuse!(
                    "stopped in the first iteration, of {steps} steps, before anything was learned; give it more time, or ask for fewer --envs or a shorter --horizon"
                ),
                other => other?,
            };
            last.1 = begun.elapsed();
            match &mut metrics {
                Some(record) => record,
                None => {
                    files::write(&self.out.join("run.json"), trainer.whole(identity) + "\n")?;
                    metrics.insert(Record::metrics(&self.out, line.step - 1)?)
                }
            }
            .write(&line)?;
            spent.add(&line, steps, trainer.engine.spent());
            if let (Some(reward), Some(length)) = (line.reward, line.length) {
                bar.say(&format!("iteration {}: mean reward {reward:.1} over {length:.0} steps", line.step));
            }
            bar.set(line.frames);
            if trainer.stop.due() {
                break;
            }
        }
        trainer.save(&checkpoint, identity)?;
        bar.finish();
        Ok(spent)
    }
}

#[derive(Clone, Debug, Default)]
struct Spent {
    rollout: f64,
    update: f64,
    parts: Vec<(&'static str, f64)>,
    steps: f64,
    /// Number of episodes that failed.
    failed: usize,
}

impl Spent {
    fn add(&mut self, line: &Iteration, steps: usize, parts: &[(&'static str, f64)]) {
        self.parts.resize(parts.len(), ("", 0.0));
        self.parts.iter_mut().zip(parts).for_each(|(sum, (name, seconds))| *sum = (name, sum.1 + seconds));
        self.rollout += line.rollout_seconds;
        self.update += line.update_seconds;
        self.steps += steps as f64;
        self.failed += line.failed;
    }

    fn seconds(&self) -> f64 {
        (self.rollout + self.update).max(1e-9)
    }

    fn rate(&self) -> Option<f64> {
        (self.steps > 0.0).then(|| self.steps / self.seconds())
    }

    /// Steps per second, and shares of the stages, as text.
    fn words(&self) -> String {
        let Some(rate) = self.rate() else {
            return "all iterations were done before; more --iterations continue".into();
        };
        let all = self.seconds();
        let whole = [("rollout", self.rollout), ("update", self.update)];
        let parts = if self.parts.is_empty() { &whole[..] } else { &self.parts };
        let shares = parts.iter().map(|(name, seconds)| format!("{name} {:.0} %", 100.0 * seconds / all)).collect_vec();
        format!("{rate:.0} steps/s: {}", shares.join(", "))
    }
}

/// Refuses a task that terminates at every start.
fn begun(episodes: &Episodes) -> Result<()> {
    let task = &episodes.task;
    let mut work = Work::new(&episodes.simulation.batch.system);
    if (0..episodes.len()).all(|env| task.terminated(episodes.view(env), &mut work)) {
        refuse!(
            "task `{}`: `terminated` is not 0 at any of its starts, so every episode ends with its first step",
            task.name()
        );
    }
    Ok(())
}

const LAST: &str = "last.safetensors";

/// Refuses a run with iterations that do not fit in memory or take longer than a day.
fn bearable(task: &dyn Task, system: &System, config: &PpoConfig) -> Result<()> {
    let seen = task.observation_dim() * config.stack;
    // Bytes per step: observations, raw and as inputs; actions, means and log standard deviations, twice; scalars such
    // as rewards.
    let a_step = 12 * seen + 24 * task.action_dim() + 100;
    let of = [("`environments`", config.environments), ("`horizon`", config.horizon)];
    bounds::memory(&of, a_step)?;
    bounds::time(
        &[&of[..], &[("the task's `frames`", task.frames() as usize), ("substeps", system.spec.substeps)]].concat(),
    )
}
