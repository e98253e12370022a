//! One run against the clock: a folder with its policies at several times.

use nerd_tasks::named;
use nerd_train::ppo::folder::{load_all, save_all};
use nerd_train::ppo::{Algorithm, Policy, PpoConfig, Shape, Trainer, play};
use nerd_train::provenance::Provenance;
use nerd_train::records::claimed;
use rayon::prelude::*;

use super::super::games::{Reward, arena_of};
use super::settings::{AT, Race};
use crate::error;
use crate::prelude::*;
use crate::report::{read_json_of, write_json};

/// What is to be run.
#[derive(Clone)]
pub struct Run {
    pub task: String,
    pub entrant: String,
    pub seed: u64,
    pub arena: Arena,
    pub config: PpoConfig,
    /// That it has.
    pub seconds: f64,
    pub out: PathBuf,
}

/// A policy that was set aside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    pub seconds: f64,
    pub iteration: u64,
    pub frames: u64,
    /// Mean reward of its run's last episodes, with noise, where it learned.
    pub trained: Option<f64>,
}

/// What came of a run; `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Task, solver and settings.
    pub identity: String,
    pub shape: Shape,
    pub kept: Vec<Kept>,
    /// Time that it took until it could begin, with what had to be compiled.
    pub compiled: f64,
    /// Time that it was given.
    pub seconds: f64,
    pub iterations: u64,
    /// Episodes that the solver could not go on with.
    pub failed: usize,
    pub provenance: Provenance,
}

/// Games of the policies of a run; `games.json`.
#[derive(Serialize, Deserialize)]
struct Played {
    games: usize,
    seed: u64,
    /// In the truth, of each policy.
    rewards: Vec<Reward>,
}

impl Run {
    pub fn new(race: &Race, task: &str, entrant: &str, seed: u64) -> Result<Self> {
        let Some((word, solver)) = entrant.split_once('-').filter(|(word, _)| Algorithm::WORDS.contains(word)) else {
            bail!("--set entrant={entrant}: {} and where it learns are needed, as in shac-neural", Algorithm::WORDS.join(" or "));
        };
        let arena = arena_of(task, solver, race.device)?;
        let own = race.settings.as_ref().map(|folder| folder.join(format!("{task}-{word}.toml"))).filter(|path| path.exists());
        let slopes = word == "shac";
        let mut config = if slopes && own.is_none() { PpoConfig::shac(task)? } else { arena.settings(task, None, own.as_deref())? };
        if (config.algorithm == Algorithm::Shac) != slopes {
            bail!("{} is not of {word}", own.unwrap_or_default().display());
        }
        config.environments = race.environments.unwrap_or(config.environments);
        // PPO's rate knows no end: the clock is its only one.
        config.iterations = if slopes { race.iterations.unwrap_or(config.iterations) } else { 1_000_000_000 };
        let out = race.runs.join(format!("{task}-{entrant}-{seed}"));
        Ok(Self { task: task.into(), entrant: entrant.into(), seed, arena, config, seconds: race.seconds, out })
    }

    /// What it is of, by content.
    fn identity(&self) -> Result<String> {
        let system = System::named(named(&self.task)?.robot())?;
        let (arena, settings) = (self.arena.identity(&system)?, serde_json::to_string(&self.config)?);
        Ok(format!("{} on {arena}, seed {}, {settings}", self.task, self.seed))
    }

    fn trainer(&self) -> Result<Trainer> {
        Ok(self.arena.trainer(named(&self.task)?, self.config.clone(), self.seed, &Default::default())?)
    }

    /// Makes it, unless it is there or another process is at it.
    pub fn make(&self) -> Result<()> {
        if self.done()?.is_some() {
            return Ok(());
        }
        std::fs::create_dir_all(&self.out).map_err(error::file(&self.out))?;
        let Ok(_claim) = claimed(&self.out) else {
            tell!("another process is at {}", self.out.display());
            return Ok(());
        };
        if self.done()?.is_some() {
            return Ok(());
        }
        let begun = Instant::now();
        self.trainer()?.iterate()?;
        let mut trainer = self.trainer()?;
        let compiled = begun.elapsed().as_secs_f64();
        let (mut kept, mut policies, mut failed, mut last) = (Vec::new(), Vec::new(), 0, None);
        let (mut clock, mut at) = (0.0, AT.into_iter().filter(|at| *at < self.seconds).chain([self.seconds]).peekable());
        while clock < self.seconds && trainer.state.iteration < self.config.iterations {
            let begun = Instant::now();
            let line = trainer.iterate()?;
            clock += begun.elapsed().as_secs_f64();
            failed += line.failed;
            let here = Kept { seconds: clock, iteration: line.step, frames: line.frames, trained: line.reward };
            if at.next_if(|at| *at <= clock).is_some() {
                while at.next_if(|at| *at <= clock).is_some() {}
                self.keep(&mut kept, &mut policies, here, &trainer);
            } else {
                last = Some(here);
            }
        }
        // Of one that ended by itself, what it came to.
        if let Some(last) = last.filter(|last| kept.last().is_none_or(|kept: &Kept| kept.iteration < last.iteration)) {
            self.keep(&mut kept, &mut policies, last, &trainer);
        }
        save_all(&self.out.join("policies.safetensors"), &policies)?;
        let (shape, iterations) = (trainer.state.policy.shape.clone(), trainer.state.iteration);
        let (identity, provenance) = (self.identity()?, Provenance::now(self.seed));
        let done = Done { identity, shape, kept, compiled, seconds: self.seconds, iterations, failed, provenance };
        write_json(&self.out.join("run.json"), &done)
    }

    fn keep(&self, kept: &mut Vec<Kept>, policies: &mut Vec<Policy>, here: Kept, trainer: &Trainer) {
        let trained = here.trained.map_or_else(|| "-".into(), |reward| format!("{reward:.1}"));
        tell!("{} {}: {:.1} s, iteration {}, reward {trained}", self.task, self.entrant, here.seconds, here.iteration);
        kept.push(here);
        policies.push(trainer.state.policy.clone());
    }

    /// What came of it, if it was made.
    pub fn done(&self) -> Result<Option<Done>> {
        let Some(done) = read_json_of::<Done>(&self.out.join("run.json"))? else { return Ok(None) };
        if done.identity != self.identity()? || done.seconds != self.seconds {
            bail!(
                "{} holds a run of another solver, of other settings or of {} s: take another --set runs",
                self.out.display(),
                done.seconds
            );
        }
        Ok(Some(done))
    }

    /// Rewards of its policies in the truth.
    pub fn play(&self, done: &Done, games: usize, seed: u64) -> Result<Vec<Reward>> {
        let path = self.out.join("games.json");
        if let Some(played) = read_json_of::<Played>(&path)?.filter(|played| (played.games, played.seed) == (games, seed)) {
            return Ok(played.rewards);
        }
        let policies = load_all(&self.out.join("policies.safetensors"), &done.shape, done.kept.len())?;
        let bar = bar(&format!("policies of {}", self.out.display()), policies.len() as u64);
        let one = |policy: &Policy| -> Result<Reward> {
            let mut episodes = Arena::Truth(Truth::Articulated).episodes(&self.task, games, seed)?;
            let games = play(policy, &mut episodes, &mut |_| ())?;
            bar.add(1);
            Ok(Reward::of(&games))
        };
        let rewards = policies.par_iter().map(one).collect::<Result<Vec<_>>>()?;
        bar.finish();
        let played = Played { games, seed, rewards };
        write_json(&path, &played)?;
        Ok(played.rewards)
    }
}
