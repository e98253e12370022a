//! Plays episodes of a policy in a truth and in a model, and computes the gap between their rewards.

use nerd_tasks::{Task, named};
use nerd_train::ppo::{Game, Policy, play};

use crate::prelude::*;

#[derive(Clone, Copy, Serialize, Deserialize)]
pub struct Reward {
    pub mean: f64,
    /// Standard deviation of the reward over episodes.
    pub spread: f64,
    #[serde(default)]
    pub standard_error: f64,
    /// Mean length of an episode (steps).
    pub length: f64,
    /// Share of successful episodes ([`Game::error`]); `None` if the task defines no success.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}

impl Reward {
    pub fn of(games: &[Game]) -> Self {
        let over = |of: &dyn Fn(&Game) -> f64| mean(&games.iter().map(of).collect_vec());
        let reward = over(&|g| g.reward);
        let spread = over(&|g| (g.reward - reward).powi(2)).sqrt();
        let judged = games.iter().any(|g| g.error.is_some());
        let success = |g: &Game| f64::from(u8::from(g.error.is_some_and(|error| error <= 1.0)));
        Self {
            mean: reward,
            spread,
            standard_error: spread / (games.len() as f64).sqrt(),
            length: over(&|g| g.length),
            success: judged.then(|| over(&success)),
            error: judged.then(|| over(&|g| g.error.unwrap_or(0.0))).filter(|error| error.is_finite()),
        }
    }
}

/// A policy's rewards in the truth and in a model.
#[derive(Serialize, Deserialize)]
pub struct Compared {
    pub real: Reward,
    pub learned: Option<Reward>,
    /// [`gap`] between both mean rewards (%); `None` if it is not finite, as for zero reward in the truth.
    pub gap: Option<f64>,
    #[serde(default)]
    pub gap_error: Option<f64>,
}

impl Compared {
    pub fn of(real: &[Game], learned: Option<&[Game]>) -> Self {
        let finite = |x: &f64| x.is_finite();
        let mean = Reward::of(real);
        let played = learned.map(Reward::of);
        Self {
            gap: played.map(|played| gap(mean.mean, played.mean)).filter(finite),
            gap_error: learned.map(|learned| gap_error(real, learned)).filter(finite),
            real: mean,
            learned: played,
        }
    }
}

/// `(learned - real) / |real|` in percent.
pub fn gap(real: f64, learned: f64) -> f64 {
    100.0 * (learned - real) / real.abs()
}

/// Standard error of [`gap`] (%) from pairs of episodes with equal starts. With rewards r in the truth and l in the
/// model, it is `sd(l - r mean(l) / mean(r)) / (sqrt(n) |mean(r)|)`.
fn gap_error(real: &[Game], learned: &[Game]) -> f64 {
    let r = Reward::of(real).mean;
    let l = Reward::of(learned).mean;
    let square = |(a, b): (&Game, &Game)| (b.reward - a.reward * l / r).powi(2);
    100.0 * real.iter().zip(learned).map(square).sum::<f64>().sqrt() / (real.len() as f64 * r.abs())
}

/// Folder of the shipped model for a task, and whether it exists.
pub fn model_of(task: &str) -> Result<(PathBuf, bool)> {
    let folder = shipped::model_of_task(task, &named(task)?.system()?.name);
    let there = folder.join("config.json").exists();
    Ok((folder, there))
}

/// The message for a missing model.
pub fn no_model(folder: &Path) -> String {
    format!("{}: there is no model: train one (`cargo xtask train`), name one with --model", folder.display())
}

pub fn input_of(task: &str, arena: &Arena) -> Result<Input> {
    let robot = match arena {
        Arena::Family(_, family) => family.name.clone(),
        _ => named(task)?.robot().to_string(),
    };
    let Some(spec) = arena.spec() else { bail!("{} is known by its name alone", arena.title()?) };
    match spec.folder() {
        Some(folder) => Input::model(folder),
        None => Input::motion(&robot, &scene(task, &robot)?, &spec.clone().on(Device::Cpu)),
    }
}

/// Returns the scene of the motion that identifies a solver. It is the task's scene, or `plane` if that scene is the
/// task's own terrain.
fn scene(task: &str, robot: &str) -> Result<String> {
    let task = named(task)?;
    let known = System::named(robot)?.scene(task.scene()).is_ok();
    Ok(if known { task.scene() } else { "plane" }.into())
}

/// Plays `n` episodes of a task under mean actions. Equal seeds give equal starts on any engine.
pub fn games(task: &str, arena: &Arena, policy: &Policy, n: usize, seed: u64) -> Result<Vec<Game>> {
    if n == 0 {
        bail!("--episodes 0: at least one is needed");
    }
    let mut episodes = arena.episodes(task, n, seed)?;
    // Keeps no frames for snapshots: these episodes are never resumed.
    episodes.remember(0);
    let bar = bar(&format!("steps of {n} games of {task} on {}", arena.title()?), episodes.task.episode_length());
    let mut step = 0;
    let games = play(policy, &mut episodes, &mut |_| {
        step += 1;
        bar.set(step);
    })?;
    bar.finish();
    Ok(games)
}

/// Returns a policy of the same shape whose actions are all 0.
pub fn still(policy: &Policy) -> Policy {
    Policy { flat: vec![0.0; policy.flat.len()], ..policy.clone() }
}

/// Counts episodes that ended before the task's episode length.
pub fn fallen(games: &[Game], task: &dyn Task) -> usize {
    games.iter().filter(|game| game.length < task.episode_length() as f64).count()
}

/// Adds the inputs of a task's episodes in a truth: the task's robot and the solver.
pub fn depend(inputs: &mut Inputs, task: &str, truth: Truth) -> Result<()> {
    inputs.add(Input::robot(&*named(task)?.system()?));
    inputs.add(input_of(task, &truth.into())?);
    Ok(())
}
