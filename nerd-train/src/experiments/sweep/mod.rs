//! One run's settings changed one at a time, every run with several seeds: errors at 10, 100 and 1000 frames of passive motion on
//! the robot's first ground, and the time of a frame on the CPU.
//!
//! A finished run is kept in `out/sweep` and not trained again.

use std::path::Path;

use nerd_sim::prelude::*;
use nerd_tasks::named;
use serde::{Deserialize, Serialize};

mod entries;

use entries::{BASE, entries};

use super::Experiment;
use super::changes::{chosen, each, model, moved};
use super::cost::microseconds;
use super::policies::Policies;
use crate::bounds::{BATCH, EMBEDDING, LAYERS, SEEDS, STARTS, TRANSITIONS, UPDATES};
use crate::device::Device;
use crate::error::Result;
use crate::evaluate::summary;
use crate::learner::Optimizer;
use crate::paper::horizon;
use crate::report::plot::{Figure, Series};
use crate::report::table::{digits, pair};
use crate::report::{Input, Inputs, Table};
use crate::run::{BaseName, RunConfig};
use crate::settings::settings;
use crate::shipped::root;

/// The set that starts from the robot's own recipe.
const SMALLEST: &str = "smallest";
/// Where runs are kept.
const RUNS: &str = "out/sweep";
/// Frames that errors are given at.
const AT: [usize; 3] = [10, 100, 1000];

settings! {
    /// One run's settings changed one at a time.
    pub struct Sweep {
        /// Set of runs: switches (one decision of training taken back, or added, at a time), sizes (width, depth and window of the
        /// network), smallest (the recipe of the robot's shipped model, with less and more of a network), forms (the paper's form,
        /// optimiser and loss beside ours), sameness (what rollouts differ in from training)
        set: String = "switches".into(), Text;
        /// Robot
        robot: String = "pendulum".into(), Text;
        /// Runs, comma-separated, beside `base` [default: all of the set]
        only: Vec<String> = Vec::new(), Texts;
        /// Seeds of data, weights and windows, comma-separated [default: 0,1,2]
        seed: Vec<u64> = vec![0, 1, 2], Wholes(SEEDS);
        /// Updates of each run
        updates: u64 = 1500, Whole(UPDATES);
        /// Sequences of 32 tokens in an update
        batch: usize = 32, Whole(BATCH);
        /// Width of the base's network
        embedding: usize = 48, Whole(EMBEDDING);
        /// Its layers
        layers: usize = 2, Whole(LAYERS);
        /// Transitions that a run starts with
        transitions: usize = 100_000, Whole(TRANSITIONS);
        /// Transitions recorded while it goes on
        fresh: usize = 200_000, Whole(0..=*TRANSITIONS.end());
        /// Trajectories of the evaluation
        starts: usize = 128, Whole(STARTS);
        /// Seeds of policies that are trained in each model, one of each task of the robot, comma-separated: their gaps say whether
        /// the model is enough [default: none]
        policies: Vec<u64> = Vec::new(), Wholes(SEEDS);
        /// With --policies: runs in whose models they are trained, comma-separated [default: all]
        judged: Vec<String> = Vec::new(), Texts;
        /// Games of each policy
        games: usize = 256, Whole(STARTS);
        /// Where networks are trained and evaluated (cpu or cuda); a frame is timed on the CPU
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// One run of one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// What is changed.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Of its network.
    pub parameters: usize,
    /// Of its training, as its card says.
    pub minutes: String,
    /// Mean |difference| over trajectories and quantities at 10, 100 and 1000 frames; none if a rollout ended in no number.
    pub at: Option<[f64; 3]>,
    /// Mean over the paper's horizon, by quantity; none if a rollout ended in no number.
    pub error: Option<Vec<f64>>,
    /// Rollouts that left.
    pub diverged: usize,
    /// A frame of one environment on one core.
    pub microseconds: f64,
    /// Gaps of policies that were trained in it (%).
    #[serde(default)]
    pub gaps: Vec<f64>,
}

/// All of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Swept {
    /// What was asked for.
    #[serde(flatten)]
    pub settings: Sweep,
    /// By seed and run.
    pub rows: Vec<Measured>,
}

impl Sweep {
    /// The run that the others change.
    fn base(&self, seed: u64) -> Result<RunConfig> {
        let Self { set, robot, embedding, layers, updates, batch, transitions, fresh, .. } = self;
        let (kept, size) = (root().join(RUNS), format!("e{embedding}l{layers}-{updates}x{batch}"));
        if set == SMALLEST {
            let folder = format!("{robot}-{set}-{updates}-{transitions}+{fresh}-seed{seed}");
            let mut run = RunConfig::recipe(robot, robot, kept.join(folder))?;
            (run.updates, run.transitions, run.fresh, run.device) = (*updates, *transitions, *fresh, self.device);
            (run.validate_every, run.record.seed) = (Some(*updates), seed);
            return Ok(run);
        }
        let mut run = RunConfig::new(robot, kept.join(format!("{robot}-{set}-{size}-{transitions}+{fresh}-seed{seed}")));
        (run.base, run.stream, run.sequence, run.optimizer) = (BaseName::Flight, true, Some(32), Optimizer::Muon);
        (run.embedding, run.layers, run.batch, run.updates) = (*embedding, *layers, *batch, *updates);
        (run.transitions, run.fresh, run.device) = (*transitions, *fresh, self.device);
        (run.huber, run.warmup, run.last_rate) = (Some(0.02), updates / 20, 0.0);
        (run.record.torque_scale, run.record.seed) = (-1.0, seed);
        // The end of the run alone is looked at: the last weights or their average.
        (run.validate_every, run.rollouts) = (Some(*updates), 32);
        Ok(run)
    }

    /// Gaps of policies trained in a run's model, of every task of the robot.
    fn gaps(&self, run: &RunConfig) -> Result<Vec<f64>> {
        let name = run.out.file_name().map(|n| n.to_string_lossy().to_string()).unwrap_or_default();
        if self.policies.is_empty() || !(self.judged.is_empty() || self.judged.contains(&name)) {
            return Ok(Vec::new());
        }
        let tasks = nerd_tasks::names().into_iter().map(|name| Ok((name, named(name)?.robot() == self.robot)));
        let tasks = tasks.collect::<Result<Vec<_>>>()?.into_iter().filter(|(_, ours)| *ours).map(|(name, _)| name.into());
        let policies = Policies {
            fresh: self.policies.clone(),
            task: tasks.collect(),
            runs: run.out.join("policies"),
            model: Some(run.out.join("model")),
            games: self.games,
            device: self.device,
            ..Policies::default()
        };
        Ok(policies.measure()?.rows.iter().filter_map(|row| row.gap).collect())
    }

    /// The scene that runs are judged in.
    fn scene(&self) -> Result<String> {
        let system = System::named(&self.robot)?;
        Ok(system.usual_scenes().into_iter().find(|s| *s != "free").unwrap_or("free").into())
    }

    /// Rolls a run's model out.
    fn measured(&self, name: &str, run: &RunConfig) -> Result<Measured> {
        let (system, scene) = (System::named(&self.robot)?, self.scene()?);
        let (model, mut learned) = model(run, &system, self.starts)?;
        // What ends in no number at all has no error to speak of.
        let mut rolled = |steps| moved(&mut learned, &system, &scene, (self.starts, steps)).ok();
        let (near, far) = (rolled(horizon(&self.robot)), rolled(AT[2]));
        let config = &model.config;
        Ok(Measured {
            name: name.into(),
            seed: run.record.seed,
            parameters: config.network.parameters(),
            minutes: config.provenance.get("minutes").cloned().unwrap_or_default(),
            at: far.as_ref().map(|r| AT.map(|frame| r.curve[frame - 1])),
            error: near.map(|r| summary(&system, &r.error)),
            diverged: far.map_or(self.starts, |r| r.diverged),
            microseconds: microseconds(&run.out.join("model"), &system, &system.scene(&scene)?)?,
            gaps: self.gaps(run)?,
        })
    }
}

impl Experiment for Sweep {
    type Data = Swept;

    fn name(&self) -> String {
        format!("sweep-{}-{}", self.set, self.robot)
    }

    fn seed(&self) -> u64 {
        self.seed.first().copied().unwrap_or_default()
    }

    fn effort(&self) -> f64 {
        let runs = entries(&self.set).and_then(|all| chosen(&all, &self.only, BASE)).map_or(0, |all| all.len());
        (runs * self.seed.len()) as f64 * self.updates as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let system = System::named(&self.robot)?;
        Ok(Inputs(vec![Input::robot(&system), Input::motion(&self.robot, &self.scene()?, &system.spec.truth.into())?]))
    }

    fn measure(&self) -> Result<Swept> {
        let entries = chosen(&entries(&self.set)?, &self.only, BASE)?;
        let bases = self.seed.iter().map(|seed| self.base(*seed)).collect::<Result<Vec<_>>>()?;
        let runs = bases.iter().flat_map(|base| entries.iter().map(|e| (*e, e.run(base))));
        let rows = each(&runs.collect::<Vec<_>>(), |change, run, _| self.measured(change.name, run))?;
        Ok(Swept { settings: self.clone(), rows })
    }

    fn tables(&self, data: &Swept) -> Result<Vec<Table>> {
        let (base, played) = (of(data, BASE), data.rows.iter().any(|m| !m.gaps.is_empty()));
        let rows = names(data).into_iter().map(|name| {
            let runs = of(data, name);
            let mut row = vec![name.to_string(), runs[0].parameters.to_string()];
            row.extend((0..AT.len()).map(|k| {
                let at = |runs: &[&Measured]| over_seeds(runs, |m| m.at.map(|at| at[k]));
                match (at(&runs), at(&base)) {
                    (Some([mean, spread]), Some([whole, _])) => format!("{} +- {} ({:.2})", digits(mean), digits(spread), mean / whole),
                    // A run that left has no error to take the mean of.
                    (None, _) => "left".into(),
                    (Some([mean, _]), None) => digits(mean),
                }
            }));
            let error = |q: usize| over_seeds(&runs, |m| Some(*m.error.as_ref()?.get(q)?)).map(|m| m[0]);
            let errors: Vec<f64> = (0..).map_while(error).collect();
            row.push(if errors.is_empty() { "left".into() } else { pair(&errors) });
            row.push(runs.iter().map(|m| m.diverged).sum::<usize>().to_string());
            row.push(over_seeds(&runs, |m| Some(m.microseconds)).map_or_else(String::new, |m| digits(m[0])));
            let gaps: Vec<f64> = runs.iter().flat_map(|m| m.gaps.iter().map(|g| g.abs())).collect();
            let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
            let most = gaps.iter().copied().fold(f64::NAN, f64::max);
            row.extend(played.then(|| if gaps.is_empty() { "-".into() } else { format!("{mean:.2} / {most:.2}") }));
            row
        });
        let [a, b, c] = AT.map(|frame| format!("{frame} frames (over base's)"));
        let mut header = vec!["run", "parameters", &a, &b, &c, "over the paper's horizon", "diverged", "us a frame, one core"];
        header.extend(played.then_some("new policies' gaps (%): mean / largest"));
        Ok(vec![Table::new("sweep", &header).with(rows).noted(&self.note()?)])
    }

    /// Of sizes, error against time.
    fn pictures(&self, data: &Swept, stem: &Path) -> Result<()> {
        if self.set != "sizes" && self.set != SMALLEST {
            return Ok(());
        }
        // A size is one point: the quickest of its runs, since others may be on the machine, and the mean of their errors.
        let series = names(data).into_iter().filter_map(|name| {
            let runs = of(data, name);
            let time = runs.iter().map(|m| m.microseconds).fold(f64::INFINITY, f64::min);
            let [error, _] = over_seeds(&runs, |m| m.error.as_ref().map(|e| e.iter().sum::<f64>() / e.len() as f64))?;
            Some(Series { name: name.into(), points: vec![(time, error, name.into())] })
        });
        let figure = Figure {
            title: format!("{}: networks of several sizes", self.robot),
            x: "microseconds a frame, one environment, one core".into(),
            y: "mean error over the paper's horizon (rad or m)".into(),
            series: series.collect(),
            front: Vec::new(),
            levels: Vec::new(),
        };
        figure.save(stem)
    }
}

impl Sweep {
    /// What the base is.
    fn note(&self) -> Result<String> {
        let mut base = self.base(self.seed())?;
        let change = entries(&self.set)?.into_iter().find(|e| e.name == BASE);
        change.iter().for_each(|e| (e.change)(&mut base));
        let form = match base.base {
            BaseName::Draft => format!("a draft of {} substeps", base.draft),
            _ => "flight".into(),
        };
        let policies = match self.policies.len() {
            0 => String::new(),
            n => format!(
                " In each model {n} policies of every task were trained, with seeds that no model met; gaps over {} games.",
                self.games
            ),
        };
        Ok(format!(
            "Each run differs from `base` in one thing: a network of width {} and {} layers on {form}, streaming, Muon, bent loss at 0.02, half of the \
             data passive, {} updates of {} sequences on {} transitions and {} fresh ones. Passive motion from {} starts: mean error (rad or m) \
             at a frame, mean and standard deviation over seeds {:?}, and divided by the base's.{policies}",
            base.embedding, base.layers, self.updates, base.batch, self.transitions, self.fresh, self.starts, self.seed
        ))
    }
}

/// Runs of one name.
fn of<'a>(data: &'a Swept, name: &str) -> Vec<&'a Measured> {
    data.rows.iter().filter(|m| m.name == name).collect()
}

/// Names of all runs, each once, as they were measured.
fn names(data: &Swept) -> Vec<&str> {
    let first = data.rows.iter().enumerate().filter(|(k, m)| data.rows[..*k].iter().all(|other| other.name != m.name));
    first.map(|(_, m)| m.name.as_str()).collect()
}

/// Mean and standard deviation over seeds, if there is a figure of each.
fn over_seeds(runs: &[&Measured], of: impl Fn(&Measured) -> Option<f64>) -> Option<[f64; 2]> {
    let x: Vec<f64> = runs.iter().map(|m| of(m)).collect::<Option<_>>()?;
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let spread = (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (x.len().max(2) - 1) as f64).sqrt();
    (!x.is_empty()).then_some([mean, spread])
}
