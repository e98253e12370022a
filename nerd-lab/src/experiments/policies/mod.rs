//! Policies in the truth and in the simulator that learned it, after the paper's protocol: games under mean actions, as many
//! from the same starts in each, beside the paper's figures.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::games::{Reward, games, gap, gap_error, truth_of};
use super::{Experiment, Measured};
use crate::error::{Result, refuse};
use crate::paper::policy_reward;
use crate::report::{Input, Inputs, Table};
use nerd_train::bounds::{SEEDS, STARTS};
use nerd_train::device::Device;
use nerd_train::ppo::{Arena, folder};
use nerd_train::progress::bar;
use nerd_train::settings::settings;
use nerd_train::shipped::{self, from_root};

mod fresh;

settings! {
    /// Policies in the truth and in the simulator that learned it.
    pub struct Policies {
        /// Name of the result [default: `policies`; of one policy its own]
        name: String = String::new(), Text;
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// The strict protocol: seeds never used before, comma-separated. Of each and every task a policy is trained in the
        /// frozen model, unless it is there; then all are played
        fresh: Vec<u64> = Vec::new(), Wholes(SEEDS);
        /// With --fresh: seeds of policies that are trained in the truth [default: none]
        truth_seeds: Vec<u64> = Vec::new(), Wholes(SEEDS);
        /// With --fresh: tasks [default: the paper's]
        task: Vec<String> = Vec::new(), Texts;
        /// With --fresh: settings of PPO, small or paper (full length)
        recipe: String = "small".into(), Words(&["small", "paper"]);
        /// With --fresh: folder of the policies' runs; the same command goes on with those that are not done
        runs: PathBuf = "out/fresh".into(), Text;
        /// With --fresh: minutes after which each training stops [default: none]
        minutes: Option<f64> = None, Positive;
        /// Folder of the learned simulator's model [default: models/TASK if it is there, else models/ROBOT]; the truth is the one it learned
        model: Option<PathBuf> = None, Text;
        /// Play in the truth alone
        truth_only: bool = false, Flag;
        /// Games of each policy (the paper: 2048)
        games: usize = 2048, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Where the learned simulators are computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// One policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub trained_in: String,
    pub truth: String,
    pub model: Option<String>,
    pub games: usize,
    pub real: Reward,
    pub learned: Option<Reward>,
    /// `(learned - real) / |real|` in percent.
    pub gap: Option<f64>,
    /// Its standard error.
    #[serde(default)]
    pub gap_error: Option<f64>,
}

impl Policies {
    /// Folders of the policies.
    pub fn folders(&self) -> Result<Vec<PathBuf>> {
        if !self.policy.is_empty() {
            return Ok(self.policy.clone());
        }
        let found = shipped::policies("")?;
        if found.is_empty() {
            refuse!("models/policies holds no policy: train one with `cargo xtask policy train`, or name one with --policy");
        }
        Ok(found)
    }

    /// Folder of the model that a task's policies are played in, and the truth that it learned.
    fn host(&self, task: &str) -> Result<(PathBuf, Truth)> {
        let robot = nerd_tasks::named(task)?.robot();
        let folder = self.model.clone().unwrap_or_else(|| shipped::model_of_task(task, robot));
        let alone = self.truth_only && self.model.is_none() && !folder.exists();
        let truth = if alone { Truth::default() } else { ModelConfig::truth_of(&folder)? };
        Ok((folder, truth))
    }

    fn row(&self, path: &Path) -> Result<Row> {
        let (config, policy) = folder::load(path)?;
        let task = config.task;
        let (model, truth) = self.host(&task)?;
        let play = |arena| games(&task, &arena, &policy, self.games, self.seed);
        let real = play(Arena::Truth(truth))?;
        let learned = Arena::Model { folder: model.clone(), device: self.device };
        let learned = if self.truth_only { None } else { Some(play(learned)?) };
        let (mean, played) = (Reward::of(&real), learned.as_deref().map(Reward::of));
        Ok(Row {
            policy: from_root(path),
            trained_in: config.solver,
            truth: truth.name(),
            model: learned.is_some().then(|| from_root(&model)),
            games: self.games,
            // Of a truth that earns nothing there is no share.
            gap: played.map(|l| gap(mean.mean, l.mean)).filter(|g| g.is_finite()),
            gap_error: learned.map(|l| gap_error(&real, &l)).filter(|g| g.is_finite()),
            real: mean,
            learned: played,
            task,
        })
    }
}

impl Experiment for Policies {
    fn name(&self) -> String {
        let one = self.policy.first().filter(|_| self.policy.len() == 1).and_then(|path| path.file_name());
        match one {
            _ if !self.name.is_empty() => self.name.clone(),
            Some(name) => name.to_string_lossy().into_owned(),
            None if !self.fresh.is_empty() => "fresh".into(),
            None => "policies".into(),
        }
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        let policies =
            if self.fresh.is_empty() { self.folders().map_or(0, |all| all.len()) } else { self.plan().map_or(0, |all| all.len()) };
        (self.games * policies * if self.truth_only { 1 } else { 2 }) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        if !self.fresh.is_empty() {
            return self.frozen();
        }
        let mut inputs = Inputs::default();
        for path in &self.folders()? {
            let task = folder::load(path)?.0.task;
            let robot = nerd_tasks::named(&task)?.robot();
            let (model, truth) = self.host(&task)?;
            inputs.add(Input::robot(&*System::named(robot)?));
            inputs.add(truth_of(&task, truth)?);
            if !self.truth_only {
                inputs.add(Input::model(&model)?);
            }
            inputs.add(Input::policy(path)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Measured> {
        let folders = if self.fresh.is_empty() { self.folders()? } else { self.train()? };
        let (bar, done) = (bar("policies played", folders.len() as u64), AtomicU64::new(0));
        let row = |path: &PathBuf| {
            let row = self.row(path);
            bar.set(1 + done.fetch_add(1, Ordering::Relaxed));
            row
        };
        let rows = folders.par_iter().map(row).collect::<Result<Vec<Row>>>()?;
        bar.finish();
        let mut tables = if self.fresh.is_empty() { Vec::new() } else { vec![fresh::summary(&rows), fresh::gaps(&rows)] };
        tables.push(each(&rows));
        Measured::new(&serde_json::json!({ "rows": rows }), tables)
    }
}

const NOTE: &str = "Reward of a game under mean actions. Gap: (reward in NeRD - in the truth) / |reward in the truth|.";

/// A gap with its standard error, where that is known.
fn percent(gap: f64, error: Option<f64>) -> String {
    match error.filter(|e| e.is_finite()) {
        Some(error) => format!("{gap:+.2} +- {error:.2}"),
        None => format!("{gap:+.2}"),
    }
}

/// Name of a policy's folder, or of its run where it is the run's own.
pub fn short(policy: &str) -> String {
    policy.strip_suffix("/policy").unwrap_or(policy).rsplit('/').next().unwrap_or_default().into()
}

/// Every policy, beside the paper's figures.
fn each(rows: &[Row]) -> Table {
    let reward = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.spread);
    let lines = rows.iter().map(|r| {
        let paper = policy_reward(&r.task);
        vec![
            r.task.clone(),
            short(&r.policy),
            r.trained_in.clone(),
            r.games.to_string(),
            reward(&r.real),
            r.learned.as_ref().map_or_else(|| "-".into(), reward),
            r.gap.map_or_else(|| "-".into(), |g| percent(g, r.gap_error)),
            paper.map_or_else(|| "-".into(), |p| format!("{} / {} ({:+.2} %)", p[0], p[1], gap(p[0], p[1]))),
        ]
    });
    let header = ["task", "policy", "trained in", "games", "reward in truth", "in NeRD", "gap (%)", "paper: truth / NeRD"];
    let note = format!("{NOTE} +-: of a reward its standard deviation over games, of a gap its standard error.");
    let mut table = Table::new("policies", &header).with(lines).noted(&note);
    if rows.iter().any(|r| r.real.success.is_some()) {
        table.header.extend(["success in truth (%)", "success in NeRD (%)"].map(String::from));
        let share = |reward: Option<&Reward>| reward.and_then(|r| r.success).map_or("-".into(), |share| format!("{:.0}", 100.0 * share));
        table.rows.iter_mut().zip(rows).for_each(|(line, row)| line.extend([share(Some(&row.real)), share(row.learned.as_ref())]));
        table.note += " Success: games whose task says that they succeeded.";
    }
    table
}
