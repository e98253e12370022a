//! How a policy's gap depends on the size of the network it was trained in, and so the cheapest network whose policies transfer.
//!
//! Each model of the Ant plays the running policies trained in `models/ant` (guests) and, if its folder has a `policy`, the one
//! trained in itself (own); both are played in the truth, too.

use std::path::{Path, PathBuf};

use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::Experiment;
use super::cost::microseconds;
use super::games::{Reward, games, gap, policy_of, truth_of};
use crate::bounds::{SEEDS, STARTS};
use crate::device::Device;
use crate::error::{Result, refuse};
use crate::evaluate::{Action, PassiveConfig, passive, summary};
use crate::paper::horizon;
use crate::ppo::{Arena, Policy};
use crate::report::plot::{Figure, Series};
use crate::report::table::{digits, pair};
use crate::report::{Input, Inputs, Table};
use crate::settings::settings;
use crate::shipped::{self, folders, from_root, root};

const ROBOT: &str = "ant";
const TASK: &str = "ant-run";
/// A model's policies transfer if their mean reward in it is at most so far (%) from that in the truth.
const TRANSFERS: f64 = 1.0;

settings! {
    /// Policies' gaps by the size of the network that they were trained in.
    pub struct Transfer {
        /// Folders of models, comma-separated [default: models/sizes/ant-*, models/ant]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Games of each policy (the paper: 2048)
        games: usize = 512, Whole(STARTS);
        /// Trajectories of passive motion
        starts: usize = 128, Whole(STARTS);
        /// Where networks are computed (cpu or cuda); a frame is timed on the CPU
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

/// One policy in one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Played {
    /// Its folder.
    pub policy: String,
    /// In the truth.
    pub real: Reward,
    /// In the model.
    pub learned: Reward,
}

/// One model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Its folder.
    pub model: String,
    /// Of its network.
    pub parameters: usize,
    /// A frame of one environment on one core.
    pub microseconds: f64,
    /// Passive motion over the paper's horizon, by quantity.
    pub error: Vec<f64>,
    /// Policies trained in it.
    pub own: Vec<Played>,
    /// Policies trained in the shipped model.
    pub guests: Vec<Played>,
}

/// All models, the cheapest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gaps {
    /// By model.
    pub rows: Vec<Row>,
}

/// The model that guests were trained in.
fn home() -> PathBuf {
    shipped::model(Truth::Articulated, ROBOT)
}

/// Shipped running policies that were trained in a learned simulator, as the paper's.
///
/// # Errors
/// If they cannot be read, or there is none.
pub(super) fn runners() -> Result<Vec<PathBuf>> {
    let found = shipped::policies(&format!("{TASK}-neural-"))?;
    if found.is_empty() {
        refuse!("models/policies has no {TASK}-neural-*: train one with `cargo xtask policy train {TASK} --solver neural`");
    }
    Ok(found)
}

/// A policy that was played in the truth.
pub(super) struct Runner {
    path: PathBuf,
    policy: Policy,
    real: Reward,
}

impl Runner {
    /// Plays it in the truth.
    pub(super) fn new(path: PathBuf, n: usize, seed: u64) -> Result<Self> {
        let policy = policy_of(&path, TASK)?;
        let real = Reward::of(&games(TASK, &Arena::Truth(Truth::Articulated), &policy, n, seed)?);
        Ok(Self { path, policy, real })
    }

    /// Plays it in a model.
    pub(super) fn play(&self, model: &Path, device: Device, n: usize, seed: u64) -> Result<Played> {
        let arena = Arena::Model { folder: model.into(), device };
        let learned = Reward::of(&games(TASK, &arena, &self.policy, n, seed)?);
        Ok(Played { policy: from_root(&self.path), real: self.real, learned })
    }
}

impl Transfer {
    /// Folders of the models.
    ///
    /// # Errors
    /// If they cannot be listed.
    pub fn models(&self) -> Result<Vec<PathBuf>> {
        if !self.model.is_empty() {
            return Ok(self.model.clone());
        }
        let mut models = folders(&root().join("models/sizes"), &format!("{ROBOT}-"))?;
        models.push(home());
        Ok(models)
    }

    fn row(&self, system: &std::sync::Arc<System>, model: &Path, guests: &[Runner]) -> Result<Row> {
        let scene = system.scene("ground")?;
        let play = |runner: &Runner| runner.play(model, self.device, self.games, self.seed);
        let own = own(model).map(|path| play(&Runner::new(path, self.games, self.seed)?)).transpose()?;
        let guests = guests.iter().map(play).collect::<Result<Vec<_>>>()?;
        let truth = Truth::Articulated;
        let mut learned = self.device.neural(model, system, Some(&truth.name()), self.starts)?;
        let protocol = PassiveConfig { starts: self.starts, steps: horizon(ROBOT), seed: self.seed, action: Action::Zero };
        let moved = passive(system, &scene, &mut *truth.solver(system), &mut learned, protocol, &mut |_| ())?;
        // Those of the model that they were trained in are no guests.
        let (own, guests) = if model == home() { (guests, Vec::new()) } else { (own.into_iter().collect(), guests) };
        Ok(Row {
            parameters: ModelConfig::read(model)?.network.parameters(),
            microseconds: microseconds(model, system, &scene)?,
            error: summary(system, &moved.error),
            own,
            guests,
            model: from_root(model),
        })
    }
}

/// The policy that was trained in a model and lies in its folder.
fn own(model: &Path) -> Option<PathBuf> {
    Some(model.join("policy")).filter(|path| path.exists())
}

impl Experiment for Transfer {
    type Data = Gaps;

    fn name(&self) -> String {
        "transfer".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.models().map_or(0, |all| all.len()) * (self.games + self.starts)) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        inputs.add(Input::robot(&*System::named(ROBOT)?));
        inputs.add(truth_of(TASK, Truth::Articulated)?);
        let models = self.models()?;
        for model in &models {
            inputs.add(Input::model(model)?);
        }
        for policy in models.iter().filter_map(|m| own(m)).chain(runners()?) {
            inputs.add(Input::policy(&policy)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Gaps> {
        let guests = runners()?.into_iter().map(|path| Runner::new(path, self.games, self.seed)).collect::<Result<Vec<_>>>()?;
        let system = System::named(ROBOT)?;
        let mut rows = self.models()?.iter().map(|model| self.row(&system, model, &guests)).collect::<Result<Vec<_>>>()?;
        rows.sort_by(|a, b| a.microseconds.total_cmp(&b.microseconds));
        Ok(Gaps { rows })
    }

    fn tables(&self, data: &Gaps) -> Result<Vec<Table>> {
        let lines = data.rows.iter().map(|r| {
            vec![r.model.clone(), r.parameters.to_string(), digits(r.microseconds), pair(&r.error), rewards(&r.own), rewards(&r.guests)]
        });
        let verdict = match data.rows.iter().find(|r| together(&r.own).is_some_and(|gap| gap.abs() < TRANSFERS)) {
            Some(row) => format!("The cheapest model whose own policies together have a gap below {TRANSFERS} %: {}.", row.model),
            None => format!("No model's own policies together have a gap below {TRANSFERS} %."),
        };
        let header = [
            "model",
            "parameters",
            "us a frame, one core",
            "passive, 500 frames (m, rad, rad)",
            "its own policies: truth / in it",
            "those of models/ant",
        ];
        let note = format!("The Ant's running policies under mean actions: reward in the truth / in the model (gap). {verdict}");
        Ok(vec![Table::new("transfer", &header).with(lines).noted(&note)])
    }

    fn pictures(&self, data: &Gaps, stem: &Path) -> Result<()> {
        // Joined by size, and not by price, which small networks hardly differ in.
        let mut by_size: Vec<&Row> = data.rows.iter().collect();
        by_size.sort_by_key(|r| r.parameters);
        let series = |name: &str, of: fn(&Row) -> &[Played]| {
            let word = |row: &Row| row.model.rsplit('/').next().unwrap_or_default().to_string();
            let point = |r: &&Row| together(of(r)).map(|gap| (r.microseconds, gap.abs(), word(r)));
            Series { name: name.into(), points: by_size.iter().filter_map(point).collect() }
        };
        let series = [series("trained in the model", |r| &r.own), series("trained in models/ant", |r| &r.guests)];
        let figure = Figure {
            title: "Ant running: gap of the reward by size of the network".into(),
            x: "microseconds a frame, one environment, one core".into(),
            y: "gap of the mean reward (%)".into(),
            series: series.into_iter().filter(|s| !s.points.is_empty()).collect(),
            front: Vec::new(),
            levels: vec![(TRANSFERS, "transfers".into())],
        };
        figure.save(stem)
    }
}

/// Gap of the mean over policies, as the paper's over seeds (%).
fn together(all: &[Played]) -> Option<f64> {
    let (real, learned) = all.iter().fold((0.0, 0.0), |(real, learned), p| (real + p.real.mean, learned + p.learned.mean));
    (!all.is_empty()).then(|| gap(real, learned))
}

fn rewards(all: &[Played]) -> String {
    let word = |p: &Played| format!("{:.0} / {:.0} ({:+.2} %)", p.real.mean, p.learned.mean, gap(p.real.mean, p.learned.mean));
    let words: Vec<String> = all.iter().map(word).collect();
    together(all).map_or_else(|| "-".into(), |gap| format!("{}; together {gap:+.2} %", words.join(", ")))
}
