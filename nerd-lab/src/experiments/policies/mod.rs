//! Policies in the truth and in the learned simulator, after the paper's protocol: games under mean actions from the same starts in each,
//! beside the paper's figures.

use nerd_train::ppo::folder::{self, PolicyConfig};
use nerd_train::{ppo::Policy, shipped::from_root};
use rayon::prelude::*;

use super::games::{Compared, depend, games, input_of, model_of, no_model};
use crate::{error::unused, prelude::*};

mod fresh;
mod tables;

settings! {
    /// Policies in the truth and in the simulator that learned it.
    pub struct Policies {
        /// Name of the result in --out [default: `policies`; of one policy its own]
        name: String = String::new(), Text;
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// The strict protocol: seeds never used before, comma-separated. For each of them and each task a policy is trained in the frozen
        /// model, unless it is there; then all are played
        fresh: Vec<u64> = Vec::new(), Wholes(SEEDS);
        /// With `fresh`: tasks [default: the paper's]
        task: Vec<String> = Vec::new(), Texts;
        /// With `fresh`: settings of PPO, small or paper (full length)
        recipe: String = "small".into(), Words(&["small", "paper"]);
        /// With `fresh`: folder of the policies' runs; the same command continues
        runs: PathBuf = "out/fresh".into(), Text;
        /// With `fresh`: minutes after which each training stops [default: none]
        minutes: Option<f64> = None, Positive(nerd_train::bounds::MINUTES);
        /// Folder of the learned simulator's model [default: models/TASK if it is there, else models/ROBOT]; the truth is the one it
        /// learned
        model: Option<PathBuf> = None, Text;
        /// Play in the truth alone
        truth_only: bool = false, Flag;
        /// Play on robots of a family in the truth, as `ant-family` or the path of a URDF whose TOML has `[vary]`, a robot a game, and in no model
        family: Option<String> = None, Text;
        /// Games of each policy (the paper: 2048)
        games: usize = 2048, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Where the learned simulators are computed, or a family's robots (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

pub use tables::{Row, short, terms};

impl Policies {
    pub fn folders(&self) -> Result<Vec<PathBuf>> {
        let (usual, bare) = (Self::default(), self.truth_only && self.family.is_none());
        unused(&[("--device", bare && self.device != usual.device)], "with --truth-only and no --family")?;
        let rest = [
            ("--task", !self.task.is_empty()),
            ("--recipe", self.recipe != usual.recipe),
            ("--runs", self.runs != usual.runs),
            ("--minutes", self.minutes.is_some()),
        ];
        unused(&rest, "without --fresh")?;
        if !self.policy.is_empty() {
            return Ok(self.policy.clone());
        }
        let found = shipped::policies("")?;
        if found.is_empty() {
            bail!("models/policies holds no policy: train one with `cargo xtask policy train`, or name one with --policy");
        }
        Ok(found)
    }

    /// Whether nothing is played in a model.
    fn alone(&self) -> bool {
        self.truth_only || self.family.is_some()
    }

    /// Folder of the model that a task's policies are played in, and the truth that it learned.
    fn host(&self, task: &str) -> Result<(PathBuf, Truth)> {
        let (folder, there) = match &self.model {
            Some(folder) => (folder.clone(), true),
            None => model_of(task)?,
        };
        if !there && !self.alone() {
            bail!("{}, or add --truth-only", no_model(&folder));
        }
        let truth = if there { ModelConfig::truth_of(&folder)? } else { Truth::default() };
        Ok((folder, truth))
    }

    /// Policies that are played, and what their games depend on.
    fn given(&self) -> Result<(usize, Inputs)> {
        let (folders, mut inputs) = (self.folders()?, Inputs::default());
        for path in &folders {
            self.played(&folder::load(path)?.0.task, !self.alone(), &mut inputs)?;
            inputs.add(Input::policy(path)?);
        }
        Ok((folders.len(), inputs))
    }

    /// Adds what a task's games depend on, in the truth and `learned`.
    fn played(&self, task: &str, learned: bool, inputs: &mut Inputs) -> Result<()> {
        let (model, truth) = self.host(task)?;
        depend(inputs, task, truth)?;
        if let Some(family) = &self.family {
            let (arena, path) = (Arena::family(task, family, truth, self.device)?, Path::new(family));
            if path.exists() {
                // A file of one's own is not found again by a robot's name.
                inputs.add(Input::files(family, &[path.into(), path.with_extension("toml")])?);
            } else {
                inputs.add(Input::robot(&*System::named(family)?));
                inputs.add(input_of(task, &arena)?);
            }
        }
        if learned {
            inputs.add(Input::model(&model)?);
        }
        Ok(())
    }

    /// Every policy's row and, of tasks for any robot, that of one whose actions are 0.
    fn rows(&self, folders: &[PathBuf]) -> Result<Vec<Row>> {
        let given = folders.iter().map(|path| Ok((folder::load(path)?, [folder::called(path)?, from_root(path)])));
        let mut all = given.collect::<Result<Vec<((PolicyConfig, Policy), [String; 2])>>>()?;
        for k in 0..all.len() {
            let ((config, policy), [task, _]) = &all[k];
            let first = all.iter().position(|(_, [other, _])| other == task) == Some(k);
            if first && !nerd_tasks::names().contains(&task.as_str()) {
                let (config, flat) = (PolicyConfig { solver: "-".into(), ..config.clone() }, vec![0.0; policy.flat.len()]);
                all.push(((config, Policy { flat, ..policy.clone() }), [task.clone(), "keeps still".into()]));
            }
        }
        let bar = bar("policies played", all.len() as u64);
        let rows = all.into_par_iter().map(|((config, policy), names)| self.row(config, &policy, names).inspect(|_| bar.add(1)));
        let rows = rows.collect();
        bar.finish();
        rows
    }

    fn row(&self, config: PolicyConfig, policy: &Policy, [called, name]: [String; 2]) -> Result<Row> {
        let task = config.task;
        let (model, truth) = self.host(&task)?;
        let play = |arena| games(&task, &arena, policy, self.games, self.seed);
        let home = self.family.as_ref().map_or(Ok(Arena::Truth(truth)), |family| Arena::family(&task, family, truth, self.device))?;
        let real = play(home.clone())?;
        let own = nerd_tasks::named(&task)?;
        let (length, (allowed, unit)) = (own.episode_length() as f64, own.allowed());
        let steps: f64 = real.iter().map(|game| game.length).sum();
        let term = |(k, name): (usize, &String)| (name.clone(), real.iter().map(|game| game.terms[k]).sum::<f64>() / steps);
        let terms = own.terms().iter().enumerate().map(term).filter(|(_, mean)| mean.is_finite()).collect();
        let fell = real.iter().filter(|game| game.length < length).count() as f64 / real.len() as f64;
        let learned = Arena::Model { folder: model.clone(), device: self.device };
        let learned = if self.alone() { None } else { Some(play(learned)?) };
        let system = own.system()?;
        let bare = system.robot.contact_points.is_empty();
        let half = if bare { Setting::Rk4(2) } else { Setting::Implicit(system.spec.substeps.div_ceil(2)) };
        let half = if self.fresh.is_empty() { None } else { Compared::of(&real, Some(&play(Arena::Judge(half))?)).gap };
        Ok(Row {
            half,
            policy: name,
            trained_in: config.solver,
            truth: home.title()?,
            fell: (self.family.is_some() || !nerd_tasks::names().contains(&task.as_str())).then_some(fell),
            model: learned.is_some().then(|| from_root(&model)),
            games: self.games,
            rewards: Compared::of(&real, learned.as_deref()),
            terms,
            allowed: (allowed != 1.0).then(|| (allowed, unit.into())),
            task: called,
        })
    }
}

impl Experiment for Policies {
    fn about(&self) -> Result<About> {
        if self.family.is_some() && !self.fresh.is_empty() {
            bail!("--family means nothing with fresh policies: train them with `cargo xtask policy train --family`");
        }
        let (policies, inputs) = if self.fresh.is_empty() { self.given()? } else { self.frozen()? };
        let effort = (self.games * policies * if self.alone() { 1 } else { 2 }) as f64;
        let one = self.policy.first().filter(|_| self.policy.len() == 1).and_then(|path| path.file_name());
        let name = match one {
            _ if !self.name.is_empty() => self.name.clone(),
            Some(name) => name.to_string_lossy().into_owned(),
            None if !self.fresh.is_empty() => "fresh".into(),
            None => "policies".into(),
        };
        Ok(About { name, seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let folders = if self.fresh.is_empty() { self.folders()? } else { self.train()? };
        let rows = self.rows(&folders)?;
        let mut all = if self.fresh.is_empty() { Vec::new() } else { vec![tables::summary(&rows), tables::gaps(&rows)] };
        all.push(tables::each(&rows));
        all.extend(tables::terms(&rows));
        let measured = Measured::new(&serde_json::json!({ "rows": rows }), all)?;
        Ok(match tables::curves(&folders) {
            Some(figure) => measured.with("curves", figure),
            None => measured,
        })
    }
}
