//! Plays policies in the truth and in the learned simulator, by the paper's protocol. Episodes have mean actions and
//! equal starts; rewards are listed beside the paper's.

use nerd_train::ppo::folder::{self, PolicyConfig};
use nerd_train::{ppo::Policy, shipped::from_root};
use rayon::prelude::*;

use super::games::{Compared, depend, fallen, games, input_of, model_of, no_model, still};
use crate::{error::unused, prelude::*};

mod fresh;
mod tables;

settings! {
    /// Settings: policies in the truth and in the simulator that learned it.
    pub struct Policies {
        /// Name of the result in --out [default: the folder's name of a single policy, `fresh` with --fresh-seeds,
        /// else
        /// `policies`]
        name: String = String::new(), Text;
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// Seeds never used before, comma-separated, for the strict protocol. For each seed and task a policy is
        /// trained in the frozen model, unless it exists. Then all of them are evaluated
        fresh_seeds: Vec<u64> = Vec::new(), Wholes(SEEDS);
        /// With --fresh-seeds: tasks, comma-separated [default: the paper's]
        task: Vec<String> = Vec::new(), Texts;
        /// With --fresh-seeds: settings of PPO, small or paper (full length)
        recipe: String = "small".into(), Words(&["small", "paper"]);
        /// With --fresh-seeds: folder of the training runs; the same command continues them
        runs: PathBuf = "out/fresh".into(), Text;
        /// With --fresh-seeds: minutes after which each training stops [default: no limit]
        minutes: Option<f64> = None, Positive(nerd_train::bounds::MINUTES);
        /// Folder of the learned simulator's model. The truth is the solver that this model learned from [default:
        /// models/TASK if it exists, else models/ROBOT]
        model: Option<PathBuf> = None, Text;
        /// Runs the policies in the truth alone
        truth_only: bool = false, Flag;
        /// Family of robots with drawn parameters, such as `ant-family`, or the path of a URDF whose TOML has `[vary]`.
        /// Each episode gets another robot, in the truth alone [default: the task's robot]
        family: Option<String> = None, Text;
        /// Episodes of each policy (the paper: 2048)
        episodes: usize = 2048, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Device that steps the learned simulator (with --family: the truth): cpu or cuda
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

pub use tables::{Row, short, terms};

impl Policies {
    pub fn folders(&self) -> Result<Vec<PathBuf>> {
        let usual = Self::default();
        let bare = self.truth_only && self.family.is_none();
        unused(&[("--device", bare && self.device != usual.device)], "with --truth-only and no --family")?;
        let rest = [
            ("--task", !self.task.is_empty()),
            ("--recipe", self.recipe != usual.recipe),
            ("--runs", self.runs != usual.runs),
            ("--minutes", self.minutes.is_some()),
        ];
        unused(&rest, "without --fresh-seeds")?;
        if !self.policy.is_empty() {
            return Ok(self.policy.clone());
        }
        let found = shipped::policies("")?;
        if found.is_empty() {
            bail!(
                "models/policies holds no policy: train one with `cargo xtask policy train`, or name one with --policy"
            );
        }
        Ok(found)
    }

    /// Whether policies of new seeds are trained first.
    fn fresh(&self) -> bool {
        !self.fresh_seeds.is_empty()
    }

    /// Whether policies are played in the truth alone.
    fn alone(&self) -> bool {
        self.truth_only || self.family.is_some()
    }

    /// Folder of the model in which a task's policies are played, and the model's truth.
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

    /// Counts the given policies, and collects the inputs of their episodes.
    fn given(&self) -> Result<(usize, Inputs)> {
        let folders = self.folders()?;
        let mut inputs = Inputs::default();
        for path in &folders {
            self.played(&folder::load(path)?.0.task, !self.alone(), &mut inputs)?;
            inputs.add(Input::policy(path)?);
        }
        Ok((folders.len(), inputs))
    }

    /// Returns the arena of a task's truth; with --family, on the family's robots and on --device.
    fn home(&self, task: &str, truth: Truth) -> Result<Arena> {
        let Some(family) = &self.family else { return Ok(truth.into()) };
        if self.device != Device::Cpu && truth == Truth::Rapier {
            bail!("--device {}: rapier is on the CPU", self.device);
        }
        Ok(Arena::family(task, family, SolverSpec::from(truth).on(self.device))?)
    }

    /// Adds the inputs of a task's episodes: in the truth, and if `learned` in the model.
    fn played(&self, task: &str, learned: bool, inputs: &mut Inputs) -> Result<()> {
        let (model, truth) = self.host(task)?;
        depend(inputs, task, truth)?;
        if let Some(family) = &self.family {
            let arena = self.home(task, truth)?;
            let path = Path::new(family);
            if path.exists() {
                // Adds a user's files by content, since no robot's name leads to them.
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

    /// Makes a row for every policy. Each task outside the built-in list also gets a row of zero actions.
    fn rows(&self, folders: &[PathBuf]) -> Result<Vec<Row>> {
        let mut all = Vec::new();
        for path in folders {
            all.push((folder::load(path)?, [folder::called(path)?, from_root(path)]));
        }
        for ((config, policy), [task, _]) in all.clone().into_iter().unique_by(|(_, [task, _])| task.clone()) {
            if own_task(&task) {
                let config = PolicyConfig { solver: "-".into(), ..config };
                all.push(((config, still(&policy)), [task, "keeps still".into()]));
            }
        }
        let bar = bar("policies played", all.len() as u64);
        let row = |((config, policy), names)| self.row(config, &policy, names).inspect(|_| bar.add(1));
        let rows = all.into_par_iter().map(row).collect();
        bar.finish();
        rows
    }

    fn row(&self, config: PolicyConfig, policy: &Policy, [called, name]: [String; 2]) -> Result<Row> {
        let task = config.task;
        let (model, truth) = self.host(&task)?;
        let play = |arena| games(&task, &arena, policy, self.episodes, self.seed);
        let home = self.home(&task, truth)?;
        let real = play(home.clone())?;
        let own = nerd_tasks::named(&task)?;
        let (tolerance, unit) = own.tolerance();
        let steps: f64 = real.iter().map(|game| game.length).sum();
        let term =
            |(k, name): (usize, &String)| (name.clone(), real.iter().map(|game| game.terms[k]).sum::<f64>() / steps);
        let terms = own.terms().iter().enumerate().map(term).filter(|(_, mean)| mean.is_finite()).collect();
        let fell = fallen(&real, &*own) as f64 / real.len() as f64;
        let learned = Arena::Solver(SolverSpec::neural(&model).on(self.device));
        let learned = if self.alone() { None } else { Some(play(learned)?) };
        let system = own.system()?;
        let half = if system.robot.contact_points.is_empty() {
            SolverSpec::articulated(nerd_train::spec::Method::Rk4, 2)
        } else {
            SolverSpec::implicit(system.spec.substeps.div_ceil(2))
        };
        let half = if self.fresh() { Compared::of(&real, Some(&play(Arena::Solver(half))?)).gap } else { None };
        Ok(Row {
            half,
            policy: name,
            trained_in: config.solver,
            truth: home.title()?,
            fell: (self.family.is_some() || own_task(&task)).then_some(fell),
            model: learned.is_some().then(|| from_root(&model)),
            games: self.episodes,
            rewards: Compared::of(&real, learned.as_deref()),
            terms,
            tolerance: (tolerance != 1.0).then(|| (tolerance, unit.into())),
            task: called,
        })
    }
}

/// Whether a task is outside the built-in list.
fn own_task(task: &str) -> bool {
    !nerd_tasks::names().contains(&task)
}

impl Experiment for Policies {
    fn about(&self) -> Result<About> {
        if self.family.is_some() && self.fresh() {
            bail!("--family means nothing with fresh policies: train them with `cargo xtask policy train --family`");
        }
        let (policies, inputs) = if self.fresh() { self.frozen()? } else { self.given()? };
        let effort = (self.episodes * policies * if self.alone() { 1 } else { 2 }) as f64;
        let one = self.policy.first().filter(|_| self.policy.len() == 1).and_then(|path| path.file_name());
        let name = match one {
            _ if !self.name.is_empty() => self.name.clone(),
            Some(name) => name.to_string_lossy().into_owned(),
            None if self.fresh() => "fresh".into(),
            None => "policies".into(),
        };
        Ok(About { name, seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let folders = if self.fresh() { self.train()? } else { self.folders()? };
        let rows = self.rows(&folders)?;
        let mut all = if self.fresh() { vec![tables::summary(&rows), tables::gaps(&rows)] } else { Vec::new() };
        all.push(tables::each(&rows));
        all.extend(tables::terms(&rows));
        Ok(Measured::new(&serde_json::json!({ "rows": rows }), all)?.with("curves", tables::curves(&folders)))
    }
}
