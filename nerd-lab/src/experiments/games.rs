//! Games of a policy in a truth and in a model, and the gap between their rewards.

use nerd_tasks::named;
use nerd_train::ppo::{Game, Policy, play};

use crate::prelude::*;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reward {
    pub mean: f64,
    /// Standard deviation of a game's.
    pub spread: f64,
    #[serde(default)]
    pub standard_error: f64,
    /// Mean length (steps).
    pub length: f64,
    /// Share of games that succeeded ([`Game::miss`]); none of a task that does not speak of success.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub success: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub miss: Option<f64>,
}

impl Reward {
    pub fn of(games: &[Game]) -> Self {
        let n = games.len() as f64;
        let mean = games.iter().map(|g| g.reward).sum::<f64>() / n;
        let spread = (games.iter().map(|g| (g.reward - mean).powi(2)).sum::<f64>() / n).sqrt();
        let succeeded = games.iter().filter(|g| g.miss.is_some_and(|miss| miss <= 1.0)).count();
        let success = games.iter().any(|g| g.miss.is_some()).then_some(succeeded as f64 / n);
        let miss = success.map(|_| games.iter().filter_map(|g| g.miss).sum::<f64>() / n).filter(|miss| miss.is_finite());
        Self { mean, spread, standard_error: spread / n.sqrt(), length: games.iter().map(|g| g.length).sum::<f64>() / n, success, miss }
    }
}

/// A policy's rewards in the truth and in a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    pub real: Reward,
    pub learned: Option<Reward>,
    /// [`gap`] (percent); none where the truth gives nothing.
    pub gap: Option<f64>,
    #[serde(default)]
    pub gap_error: Option<f64>,
}

impl Compared {
    pub fn of(real: &[Game], learned: Option<&[Game]>) -> Self {
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let (mean, played) = (Reward::of(real), learned.map(Reward::of));
        let gap = played.and_then(|played| finite(gap(mean.mean, played.mean)));
        Self { real: mean, learned: played, gap, gap_error: learned.and_then(|learned| finite(gap_error(real, learned))) }
    }
}

/// `(learned - real) / |real|` in percent.
pub fn gap(real: f64, learned: f64) -> f64 {
    100.0 * (learned - real) / real.abs()
}

/// Standard error of [`gap`] between the means of games that began alike, pair by pair:
/// `sd(l - r mean(l) / mean(r)) / (sqrt(n) |mean(r)|)`.
fn gap_error(real: &[Game], learned: &[Game]) -> f64 {
    let (r, l) = (Reward::of(real).mean, Reward::of(learned).mean);
    let square = |(a, b): (&Game, &Game)| (b.reward - a.reward * l / r).powi(2);
    100.0 * real.iter().zip(learned).map(square).sum::<f64>().sqrt() / (real.len() as f64 * r.abs())
}

/// Folder of the model that comes with the project for a task, and whether it is there.
pub fn model_of(task: &str) -> Result<(PathBuf, bool)> {
    let folder = shipped::model_of_task(task, &named(task)?.system()?.name);
    let there = folder.join("config.json").exists();
    Ok((folder, there))
}

/// That one is not there, and what to do.
pub fn no_model(folder: &Path) -> String {
    format!("{}: there is no model: train one (`cargo xtask train`), name one with --model", folder.display())
}

/// The model that comes with the project for a task.
pub fn learned(task: &str, device: Device) -> Result<Arena> {
    match model_of(task)? {
        (folder, true) => Ok(Arena::Model { folder, device }),
        (folder, false) => bail!("{}", no_model(&folder)),
    }
}

/// The truth of every robot, on a device.
pub fn truth_on(device: Device) -> Result<Arena> {
    #[cfg(feature = "cuda")]
    if device.is_cuda() {
        return Ok(Arena::Card(Setting::Accurate));
    }
    if device.is_cuda() {
        bail!("--device {device} needs a build with `--features cuda`");
    }
    Ok(Arena::Truth(Truth::Articulated))
}

pub fn input_of(task: &str, arena: &Arena) -> Result<Input> {
    let setting = match arena {
        Arena::Model { folder, .. } => return Input::model(folder),
        Arena::Truth(truth) => (*truth).into(),
        Arena::Family(truth, family, _) => return Input::motion(&family.name, &scene(task, &family.name)?, &(*truth).into()),
        Arena::Judge(setting) => setting.clone(),
        #[cfg(feature = "cuda")]
        Arena::Card(setting) => setting.clone(),
        Arena::Guest(name, _) => bail!("{name} is known by its name alone"),
    };
    let robot = named(task)?.robot().to_string();
    Input::motion(&robot, &scene(task, &robot)?, &setting)
}

/// The scene by which it is seen how a solver moves. A task's own terrain, whose text a policy has in its folder, is no scene of its robot: there
/// the plane.
fn scene(task: &str, robot: &str) -> Result<String> {
    let task = named(task)?;
    let known = System::named(robot)?.scene(task.scene()).is_ok();
    Ok(if known { task.scene() } else { "plane" }.into())
}

/// Plays `n` episodes of a task under mean actions. Episodes of the same seed begin alike, on any engine.
pub fn games(task: &str, arena: &Arena, policy: &Policy, n: usize, seed: u64) -> Result<Vec<Game>> {
    if n == 0 {
        bail!("--games 0: at least one is needed");
    }
    let mut episodes = arena.episodes(task, n, seed)?;
    // Nobody goes on with these.
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

/// Adds what a task's games depend on in a truth.
pub fn depend(inputs: &mut Inputs, task: &str, truth: Truth) -> Result<()> {
    inputs.add(Input::robot(&*named(task)?.system()?));
    inputs.add(input_of(task, &Arena::Truth(truth))?);
    Ok(())
}
