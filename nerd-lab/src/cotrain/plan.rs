//! From settings to a loop: what is refused, what it starts from, and by what it is known.

use std::path::{Path, PathBuf};
use std::time::Instant;

use nerd_model::folder::{Model, ModelConfig};
use nerd_sim::prelude::*;
use nerd_tasks::named;
use serde_json::{Value, json};

use super::{CoTrain, CoTrainConfig};
use crate::error::{Error, Result, refuse};
use crate::report::write;
use nerd_train::difference::between;
use nerd_train::ppo::{Arena, PpoConfig};
use nerd_train::run::{Recipe, Run, RunConfig};
use nerd_train::settings::{Given, Settings};
use nerd_train::shipped;

/// Updates of a training on that nobody says anything about.
const UPDATES: u64 = 100_000;

/// Where the first model comes from.
pub(super) enum First {
    /// It is there.
    Model(PathBuf),
    /// It is trained from nothing.
    Recipe(Recipe),
}

impl CoTrain {
    /// The loop of these settings; its folder is `out/co-train-ROBOT` if none is named.
    ///
    /// # Errors
    /// If a setting makes no sense, tasks are of two robots, or a file cannot be read.
    pub fn new(tasks: Vec<String>, config: CoTrainConfig, out: Option<PathBuf>) -> Result<Self> {
        check(&config)?;
        let robot = robot_of(&tasks)?;
        let system = System::named(robot)?;
        let out = out.unwrap_or_else(|| format!("out/co-train-{robot}").into());
        let recipe = config.recipe.as_deref().map(|named| recipe(named, robot, &config, &out)).transpose()?;
        let model = config.model.as_deref().map(shipped::find);
        let found = model.as_deref().map(|folder| Model::load(folder, &system, None)).transpose()?.map(|model| model.config);
        let onward = match (&recipe, &found) {
            (Some(recipe), _) => recipe.runs.last().cloned(),
            (None, Some(found)) => Some(RunConfig::onward(found, UPDATES)?),
            (None, None) => None,
        };
        let Some(mut onward) = onward else { refuse!("--model or --recipe is needed: the first round needs a model, or a way to one") };
        let truth = model.as_deref().map_or_else(|| Ok(onward.record.truth(&system)), ModelConfig::truth_of)?;
        if recipe.is_some() && truth != onward.record.truth(&system) {
            let (learned, asked) = (truth.name(), onward.record.truth(&system).name());
            refuse!("--model has learned `{learned}`, --recipe learns `{asked}`: one loop has one truth");
        }
        onward.record.truth = Some(truth);
        lengthen(&mut onward, config.updates);
        (onward.device, onward.minutes, onward.finish, onward.data, onward.epsilon) = (config.device, None, false, None, None);
        (onward.out, onward.from) = (out.clone(), model.clone());
        // As far as it can be said before there are policies.
        let next = match (&model, &recipe) {
            (None, Some(recipe)) => recipe.runs.first(),
            _ => Some(&onward),
        };
        next.map(Run::new).transpose()?;
        let arena = Arena::Model { folder: out.clone(), device: config.device };
        let ppo = |task: &String| -> Result<PpoConfig> {
            let mut ppo = PpoConfig::choose(task, &arena, None, config.config.as_deref())?;
            ppo.iterations = config.iterations.unwrap_or(ppo.iterations);
            ppo.check()?;
            Ok(ppo)
        };
        let ppo = tasks.iter().map(ppo).collect::<Result<_>>()?;
        let first = match (model, recipe) {
            (None, Some(recipe)) => First::Recipe(recipe),
            (model, _) => First::Model(model.unwrap_or_default()),
        };
        Ok(Self { tasks, config, out, system, truth, first, onward, ppo, started: Instant::now() })
    }

    /// Refuses to go on with another loop's folder. Limits may change: rounds, minutes, the rule.
    pub(super) fn hold(&self) -> Result<()> {
        let CoTrainConfig { seeds, breadth, games, policy_share, seed, .. } = self.config;
        let first = match &self.first {
            First::Model(folder) => json!(ModelConfig::read(folder)?.model_sha256),
            First::Recipe(recipe) => recipe.runs.iter().map(settings_of).collect(),
        };
        let asked = json!({
            "tasks": self.tasks, "first": first, "onward": settings_of(&self.onward), "ppo": self.ppo, "seeds": seeds, "breadth": breadth,
            "games": games, "policy-share": policy_share, "seed": seed,
        });
        let path = self.out.join("co-train.json");
        if path.exists() {
            let found = nerd_sim::files::read_text(&path).map_err(crate::error::file(&path))?;
            // As they are read: a number that is written and read may have another last digit.
            let said = between(&found, &asked.to_string());
            if !said.is_empty() {
                refuse!("{} is of other settings: {said}; use another --out, or its settings", path.display());
            }
            return Ok(());
        }
        write(&path, serde_json::to_string_pretty(&asked).map_err(crate::error::format(&path))?.as_bytes())
    }
}

/// Each setting within its range.
fn check(config: &CoTrainConfig) -> Result<()> {
    let given = config.given();
    for key in CoTrainConfig::keys() {
        let (name, value) = (key.name(), given.get(&key.name()).unwrap_or(&Value::Null));
        if !value.is_null() {
            key.values.check(value).map_err(|needed| Error::msg(format!("--{name} {value}: {needed}")))?;
        }
    }
    Ok(())
}

/// The one robot of all tasks.
fn robot_of(tasks: &[String]) -> Result<&'static str> {
    let Some(first) = tasks.first() else { refuse!("at least one task is needed") };
    let robot = named(first)?.robot();
    for (k, task) in tasks.iter().enumerate() {
        let other = named(task)?.robot();
        if other != robot {
            refuse!("`{first}` is a task of `{robot}`, `{task}` of `{other}`: a model is of one robot, so is a loop");
        }
        if tasks[..k].contains(task) {
            refuse!("`{task}` is named twice; --seeds says how many policies it has");
        }
    }
    Ok(robot)
}

/// A recipe of that robot, by its name or from a file.
fn recipe(named: &str, robot: &str, config: &CoTrainConfig, out: &Path) -> Result<Recipe> {
    let file = Path::new(named);
    let read = |given: &Given| match file.extension().is_some_and(|e| e == "toml") || file.exists() {
        true => Recipe::read(file, given),
        false => Recipe::named(named, given),
    };
    let own = read(&Given::new())?.runs.first().map_or_else(String::new, |run| run.robot.clone());
    if !own.is_empty() && own != robot {
        refuse!("--recipe {named} trains `{own}`, the tasks are of `{robot}`");
    }
    let device = serde_json::to_value(config.device).unwrap_or_default();
    let given = [("robot", robot.into()), ("out", out.join("round-0").display().to_string().into()), ("device", device)];
    Ok(read(&given.map(|(key, value)| (key.to_string(), value)).into_iter().collect())?)
}

/// Another number of updates, with as much fresh data for each.
fn lengthen(run: &mut RunConfig, updates: Option<u64>) {
    let Some(updates) = updates else { return };
    run.fresh = (run.fresh as u128 * u128::from(updates) / u128::from(run.updates)) as usize;
    (run.updates, run.warmup, run.validate_every) = (updates, run.warmup.min(updates / 10), None);
}

/// What of a run's settings decides what it learns.
fn settings_of(run: &RunConfig) -> Value {
    let elsewhere = ["out", "from", "minutes", "device", "finish"];
    run.given().into_iter().filter(|(key, value)| !value.is_null() && !elsewhere.contains(&key.as_str())).collect::<Given>().into()
}
