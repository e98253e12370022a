//! `cargo xtask policy evaluate cartpole-swingup --policy models/policies/cartpole-swingup-neural-0`: the paper's protocol, 2048
//! games under mean actions, in the truth and in the simulator that learned it.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;
use nerd_tasks::named;
use nerd_train::ppo::{Policy, folder, play};
use serde::{Deserialize, Serialize};

use super::arena::Arena;
use crate::common::{DEVICES, Device, word};
use crate::numbers::{SEEDS, STARTS, count};
use crate::paper::policy_reward;
use crate::provenance::Provenance;
use crate::solvers::SolverName;
use crate::table::markdown;
use crate::truth::Truth;

/// Play a policy in the truth and in the learned simulator.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    /// Task, as at `policy train`
    pub task: String,
    /// Folder of the policy
    #[arg(long)]
    pub policy: PathBuf,
    /// Folder of the learned simulator's model [default: models/ROBOT]; the truth is the one it learned
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Play in the truth alone
    #[arg(long)]
    pub truth_only: bool,
    /// Games (the paper: 2048)
    #[arg(long, default_value_t = 2048, value_parser = count::<usize>(STARTS))]
    pub games: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Where the learned simulator is computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// JSON file to write
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Mean and spread over games.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reward {
    /// Mean return.
    pub mean: f64,
    /// Standard deviation of a game's.
    pub spread: f64,
    /// Mean length (steps).
    pub length: f64,
}

/// One policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Task.
    pub task: String,
    /// Folder of the policy.
    pub policy: String,
    /// What it was trained in.
    pub trained_in: String,
    /// Truth it was played in.
    pub truth: String,
    /// Model it was played in.
    pub model: Option<String>,
    /// Games in each.
    pub games: usize,
    /// In the truth.
    pub real: Reward,
    /// In the learned simulator.
    pub learned: Option<Reward>,
    /// `(learned - real) / |real|` in percent.
    pub gap: Option<f64>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    let rows = [row(&args)?];
    println!("{}", table(&rows));
    args.out.as_ref().map_or(Ok(()), |path| write(path, &rows, args.seed))
}

/// Plays one policy.
pub fn row(args: &EvaluateArgs) -> Result<Row> {
    if args.games == 0 {
        bail!("--games 0: at least one is needed");
    }
    let robot = named(&args.task)?.robot();
    let (config, policy) = folder::load(&args.policy)?;
    if config.task != args.task {
        bail!("{} is a policy of `{}`, not of `{}`", args.policy.display(), config.task, args.task);
    }
    let arena = Arena { solver: SolverName::Neural, model: args.model.clone(), device: args.device };
    let model = arena.folder(robot);
    let truth = if args.truth_only && args.model.is_none() && !model.exists() { Truth::default() } else { ModelConfig::truth_of(&model)? };
    let real = match truth {
        Truth::Articulated => SolverName::Articulated,
        _ => SolverName::Rapier,
    };
    let played = |arena: &Arena| reward(&args.task, arena, &policy, args.games, args.seed);
    let real = played(&Arena { solver: real, ..arena.clone() })?;
    let learned = if args.truth_only { None } else { Some(played(&arena)?) };
    Ok(Row {
        task: args.task.clone(),
        policy: args.policy.display().to_string(),
        trained_in: config.solver,
        truth: truth.name(),
        model: (!args.truth_only).then(|| model.display().to_string()),
        games: args.games,
        real,
        learned,
        // Of a truth that earns nothing there is no share.
        gap: learned.map(|l| gap(real.mean, l.mean)).filter(|g| g.is_finite()),
    })
}

/// `(learned - real) / |real|` in percent.
pub fn gap(real: f64, learned: f64) -> f64 {
    100.0 * (learned - real) / real.abs()
}

/// Plays so many games of a task in an arena.
pub fn reward(task: &str, arena: &Arena, policy: &Policy, games: usize, seed: u64) -> Result<Reward> {
    let mut episodes = arena.episodes(task, games, seed)?;
    episodes.remember(0);
    let bar = crate::common::bar(&format!("steps of {games} games of {task} on {}", arena.word()), episodes.task.episode_length());
    let mut step = 0;
    let games = play(policy, &mut episodes, &mut |_| {
        step += 1;
        bar.set(step);
    })?;
    bar.finish();
    let n = games.len() as f64;
    let mean = games.iter().map(|g| g.reward).sum::<f64>() / n;
    let spread = (games.iter().map(|g| (g.reward - mean).powi(2)).sum::<f64>() / n).sqrt();
    Ok(Reward { mean, spread, length: games.iter().map(|g| g.length).sum::<f64>() / n })
}

/// Writes rows with their provenance.
pub fn write(path: &Path, rows: &[Row], seed: u64) -> Result<()> {
    let json = serde_json::json!({ "provenance": Provenance::now(seed), "rows": rows });
    crate::files::write(path, (serde_json::to_string_pretty(&json)? + "\n").as_bytes())
}

/// The rows as a Markdown table, beside the paper's figures.
pub fn table(rows: &[Row]) -> String {
    let reward = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.spread);
    let cells = rows.iter().map(|r| {
        let paper = policy_reward(&r.task);
        vec![
            r.task.clone(),
            r.trained_in.clone(),
            r.games.to_string(),
            reward(&r.real),
            r.learned.as_ref().map_or_else(|| "-".into(), reward),
            r.gap.map_or_else(|| "-".into(), |g| format!("{g:+.2} %")),
            paper.map_or_else(|| "-".into(), |p| format!("{} / {} ({:+.2} %)", p[0], p[1], 100.0 * (p[1] - p[0]) / p[0])),
        ]
    });
    markdown(&["task", "trained in", "games", "reward in truth", "in NeRD", "gap", "paper: truth / NeRD"], &cells.collect::<Vec<_>>())
}
