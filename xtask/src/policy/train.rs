//! `cargo xtask policy train cartpole-swingup --solver neural`: PPO with the paper's settings, `small` ones, or your own.
//!
//! The run folder holds `metrics.jsonl`, `last.safetensors` and, drawn at the end, `curve.svg` and `curve.png`; the same
//! command continues it. The policy with the largest mean reward is written to `<out>/policy`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nerd_sim::files::claim;
use nerd_sim::prelude::*;
use nerd_tasks::{Task, named};
use nerd_train::metrics::Metrics;
use nerd_train::ppo::{PpoConfig, Trainer};

use super::arena::Arena;
use super::clock::{Clock, Split};
use super::{card, curve};
use crate::common::Device;
use crate::numbers::{self, SEEDS, count, finite, positive};
use crate::solvers::SolverName;
use nerd_train::sessions;

/// Train a policy.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// Task: cartpole-swingup, ant-run, ant-spin, ant-spin-track, franka-reach, franka-reach-torque, anymal-forward, anymal-side
    pub task: String,
    #[command(flatten)]
    pub arena: Arena,
    /// Settings of PPO: `paper`, or `small` where steps are dear [default: paper; small for a learned simulator on the CPU, if
    /// the task has it]
    #[arg(long, value_enum)]
    pub recipe: Option<Recipe>,
    /// TOML with all settings, in place of a recipe (see nerd-train/assets/ppo)
    #[arg(long, value_name = "FILE", conflicts_with = "recipe")]
    pub config: Option<PathBuf>,
    /// Environments, in place of the settings'
    #[arg(long)]
    pub envs: Option<usize>,
    /// Steps of an environment in one iteration, in place of the settings'
    #[arg(long)]
    pub horizon: Option<usize>,
    /// Iterations in the whole run, in place of the settings'
    #[arg(long, value_parser = count::<u64>(1..=1_000_000_000))]
    pub iterations: Option<u64>,
    /// Steps in a minibatch, in place of the settings'
    #[arg(long)]
    pub minibatch: Option<usize>,
    /// Stop once the mean reward of the last episodes has reached this
    #[arg(long, value_parser = finite)]
    pub until: Option<f64>,
    /// Stop, with a checkpoint, after so many minutes; the same command continues
    #[arg(long, value_parser = positive)]
    pub minutes: Option<f64>,
    /// Seed of weights, noise and starts
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder of the run [default: out/policies/TASK-SOLVER-SEED]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Settings that come with the project.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recipe {
    /// The paper's.
    Paper,
    /// Fewer environments, more updates a step.
    Small,
}

/// Two checkpoints are at least this far apart (s).
const SAVE_SECONDS: u64 = 60;

/// Runs the verb.
pub fn run(args: TrainArgs) -> Result<()> {
    args.arena.check()?;
    let (task, config) = (named(&args.task)?, settings(&args)?);
    memory(&*task, &config)?;
    let (system, solver) = (System::named(task.robot())?, args.arena.title(task.robot())?);
    let out = args.out.clone().unwrap_or_else(|| format!("out/policies/{}-{}-{}", args.task, args.arena.word(), args.seed).into());
    let run = format!("{} on {solver}", args.task);
    // What a checkpoint is known by: a model is its weights, wherever they are.
    let identity = format!("{} on {}", args.task, args.arena.identity(&system)?);
    let started = Instant::now();
    let (clock, mut split) = (Clock::default(), Split::default());
    let episodes = args.arena.timed(&args.task, config.environments, args.seed, &clock)?;
    let mut trainer = Trainer::new(episodes, config, args.seed)?;
    let _claim = claim(&out)?;
    let checkpoint = out.join("last.safetensors");
    if checkpoint.exists() {
        trainer.resume(&checkpoint, &identity).with_context(|| format!("{} holds another run; choose another --out", out.display()))?;
        eprintln!("going on at iteration {} of {}", trainer.state.iteration, trainer.config.iterations);
    }
    let first = trainer.state.iteration;
    let mut metrics = Metrics::open(&out.join("metrics.jsonl"), first)?;
    let (steps, total) = (trainer.config.steps() as u64, trainer.config.iterations);
    let bar = crate::common::bar(&format!("steps of {run}"), total * steps);
    let (mut saved, mut failed, mut reached) = (Instant::now(), 0, None);
    while trainer.state.iteration < total && reached.is_none() {
        let line = trainer.iterate()?;
        metrics.write(&line)?;
        split.add(&line, trainer.config.steps());
        failed += line.failed;
        if let (Some(reward), Some(length)) = (line.reward, line.length) {
            bar.say(&format!("iteration {}: mean reward {reward:.1} over {length:.0} steps", line.step));
        }
        bar.set(line.frames);
        let enough = args.until.zip(line.reward).is_some_and(|(wanted, reward)| reward >= wanted && trainer.state.best.is_some());
        reached = line.reward.filter(|_| enough);
        let late = args.minutes.is_some_and(|m| started.elapsed().as_secs_f64() > 60.0 * m);
        if late || saved.elapsed() > Duration::from_secs(SAVE_SECONDS) {
            trainer.save(&checkpoint, &identity)?;
            saved = Instant::now();
        }
        if late {
            break;
        }
    }
    bar.finish();
    trainer.save(&checkpoint, &identity)?;
    // Asked again, a finished run keeps its times.
    if trainer.state.iteration > first || !sessions::any(&out) {
        sessions::log(&out, first, trainer.state.iteration, started.elapsed().as_secs_f64(), &split.words(&clock))?;
    }
    curve::draw(&out, &run)?;
    card::export(&out, &args.task, (&solver, &identity), &trainer)?;
    let (_, best) = trainer.best();
    let reward = best.map_or("no full set of episodes yet".into(), |r| format!("best mean reward {r:.1}"));
    let seconds = started.elapsed().as_secs_f64();
    println!("{run}: {reward} in {} iterations, {seconds:.0} s here; {}", trainer.state.iteration, out.join("policy").display());
    println!("{}", split.words(&clock));
    if failed > 0 {
        eprintln!("{failed} episodes ended because the solver could not go on with them");
    }
    Ok(())
}

/// The task's settings, or those of a file, as the command line changes them.
fn settings(args: &TrainArgs) -> Result<PpoConfig> {
    let mut config = match &args.config {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            PpoConfig::from_text(&text).with_context(|| path.display().to_string())?
        }
        None => {
            let dear = args.arena.solver == SolverName::Neural && args.arena.device == Device::Cpu;
            match (args.recipe, PpoConfig::small(&args.task)) {
                (Some(Recipe::Small), None) => bail!("task `{}` has no small settings; --config takes your own", args.task),
                (Some(Recipe::Small), Some(small)) => small,
                (None, Some(small)) if dear => small,
                _ => PpoConfig::of(&args.task)?,
            }
        }
    };
    config.environments = args.envs.unwrap_or(config.environments);
    config.horizon = args.horizon.unwrap_or(config.horizon);
    config.iterations = args.iterations.unwrap_or(config.iterations);
    config.minibatch = args.minibatch.unwrap_or(config.minibatch);
    config.check()?;
    Ok(config)
}

/// Refuses a run whose steps of one iteration do not fit in memory.
fn memory(task: &dyn Task, config: &PpoConfig) -> Result<()> {
    let seen = task.observation_dim() * config.stack;
    // Observations, and as inputs; actions, means and spreads, twice; rewards, values, advantages and the like.
    let a_step = 12 * seen + 24 * task.action_dim() + 100;
    numbers::memory(&[("`environments`", config.environments), ("`horizon`", config.horizon)], a_step)
}
