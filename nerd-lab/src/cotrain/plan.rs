//! The loop's plan from its settings: checks, first model, identity.

use nerd_tasks::named;
use nerd_train::run::{Recipe, Run, RunConfig};
use nerd_train::settings::{Given, Settings};
use nerd_train::{bounds::UPDATES, difference::between, ppo::PpoConfig};
use serde_json::{Value, json};

use crate::{prelude::*, report::write_json};

/// Default number of updates of further training.
const USUAL: u64 = 100_000;

settings! {
    /// Policies and model in turn.
    pub struct CoTrainConfig {
        /// Folder of the first round's model [default: that of the robot]
        model: Option<PathBuf> = None, Text;
        /// Recipe of `train` (its name or a file): models are trained on with the settings of its last run
        recipe: Option<String> = None, Text;
        /// TOML with all settings of PPO (see nerd-train/assets/ppo) [default: the task's]
        config: Option<PathBuf> = None, Text;
        /// Policies of each task in each round, of seeds never used before
        seeds: usize = 5, Whole(1..=1000);
        /// Iterations of a policy [default: those of its settings]
        iterations: Option<u64> = None, Whole(1..=1_000_000_000);
        /// Games of each policy, in the model and from the same starts in the truth (the paper: 2048)
        games: usize = 2048, Whole(STARTS);
        /// Stop once the sizes of the gaps of every task are below this in the mean (percent)
        mean: f64 = 1.0, Positive;
        /// And none is above this (percent)
        most: f64 = 2.0, Positive;
        /// Stop after so many rounds
        rounds: usize = 5, Whole(1..=1000);
        /// Stop after so many minutes and keep what is done; the same command continues
        minutes: Option<f64> = None, Positive;
        /// Updates of each training on [default: those of the recipe's last run; without a recipe 100000]
        updates: Option<u64> = None, Whole(UPDATES);
        /// Share of the trajectories in which policies of all rounds act
        policy_share: f64 = 0.5, Number(0.01..=1.0);
        /// Seed of the first policy; each next one has the next seed, in all rounds
        seed: u64 = 1000, Whole(SEEDS);
        /// Where networks are computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// The loop, ready to run. All that can be refused has been refused.
pub(super) struct Plan {
    pub tasks: Vec<String>,
    pub config: CoTrainConfig,
    pub out: PathBuf,
    pub truth: Truth,
    pub model: PathBuf,
    /// A training on, but for what it starts from and who acts in its data.
    pub onward: RunConfig,
    pub ppo: Vec<PpoConfig>,
    started: Instant,
}

impl Plan {
    /// The loop of these settings; its folder is `out/co-train-ROBOT` if none is named.
    pub fn new(tasks: Vec<String>, config: CoTrainConfig, out: Option<PathBuf>) -> Result<Self> {
        let robot = robot_of(&tasks)?;
        let system: Arc<System> = System::named(robot)?;
        let out = out.unwrap_or_else(|| format!("out/co-train-{robot}").into());
        let model = shipped::find(config.model.as_deref().unwrap_or(&Path::new("models").join(robot)));
        let found = Model::load(&model, &system, None)?.config;
        let mut onward = match &config.recipe {
            None => RunConfig::onward(&found, USUAL)?,
            Some(named) => last_of(named, robot)?,
        };
        let (truth, asked) = (ModelConfig::truth_of(&model)?, onward.record.truth(&system));
        if config.recipe.is_some() && truth != asked {
            bail!("--model has learned `{}`, --recipe learns `{}`: one loop has one truth", truth.name(), asked.name());
        }
        onward.record.truth = Some(truth);
        lengthen(&mut onward, config.updates);
        (onward.device, onward.minutes, onward.finish, onward.data, onward.epsilon) = (config.device, None, false, None, None);
        (onward.out, onward.from) = (out.clone(), Some(model.clone()));
        // As far as it is known before there are policies.
        Run::new(&onward)?;
        let arena = Arena::Model { folder: out.clone(), device: config.device };
        let ppo = |task: &String| -> Result<PpoConfig> {
            let mut ppo = arena.settings(task, None, config.config.as_deref())?;
            ppo.iterations = config.iterations.unwrap_or(ppo.iterations);
            ppo.check().map_err(anyhow::Error::msg)?;
            Ok(ppo)
        };
        let ppo = tasks.iter().map(ppo).collect::<Result<_>>()?;
        Ok(Self { tasks, config, out, truth, model, onward, ppo, started: Instant::now() })
    }

    /// Refuses to go on with another loop's folder. Limits may change: rounds, minutes, the rule.
    pub fn hold(&self) -> Result<()> {
        let CoTrainConfig { seeds, games, policy_share, seed, .. } = self.config;
        let asked = json!({
            "tasks": self.tasks, "first": ModelConfig::read(&self.model)?.model_sha256, "onward": settings_of(&self.onward),
            "ppo": self.ppo, "seeds": seeds, "games": games, "policy-share": policy_share, "seed": seed,
        });
        let path = self.out.join("co-train.json");
        if !path.exists() {
            return write_json(&path, &asked);
        }
        let found = nerd_sim::files::read_text(&path).map_err(crate::error::file(&path))?;
        // As they are read: a number that is written and read may have another last digit.
        let apart = between(&found, &asked.to_string());
        if !apart.is_empty() {
            bail!("{} is of other settings: {apart}; use another --out, or its settings", path.display());
        }
        Ok(())
    }

    /// Minutes that are left, if they are limited; none below zero.
    pub fn left(&self) -> Option<f64> {
        self.config.minutes.map(|all| (all - self.started.elapsed().as_secs_f64() / 60.0).max(0.0))
    }
}

/// The last run of a recipe of that robot, by its name or from a file.
fn last_of(named: &str, robot: &str) -> Result<RunConfig> {
    let (file, given): (_, Given) = (Path::new(named), [("robot".to_string(), robot.into())].into_iter().collect());
    let recipe = |given: &Given| match file.extension().is_some_and(|e| e == "toml") || file.exists() {
        true => Recipe::read(file, given),
        false => Recipe::named(named, given),
    };
    let own = recipe(&Given::new())?.runs.first().map_or_else(String::new, |run| run.robot.clone());
    if !own.is_empty() && own != robot {
        bail!("--recipe {named} trains `{own}`, the tasks are of `{robot}`");
    }
    match recipe(&given)?.runs.pop() {
        Some(last) => Ok(last),
        None => bail!("--recipe {named} has no runs"),
    }
}

fn robot_of(tasks: &[String]) -> Result<&'static str> {
    let Some(first) = tasks.first() else { bail!("at least one task is needed") };
    let robot = named(first)?.robot();
    for (k, task) in tasks.iter().enumerate() {
        let other = named(task)?.robot();
        if other != robot {
            bail!("`{first}` is a task of `{robot}`, `{task}` of `{other}`: a model is of one robot, so is a loop");
        }
        if tasks[..k].contains(task) {
            bail!("`{task}` is named twice; --seeds says how many policies it has");
        }
    }
    Ok(robot)
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
