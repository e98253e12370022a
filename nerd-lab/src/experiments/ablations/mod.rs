//! The paper's Figure A.2: NeRD is trained beside itself with one design decision taken back at a time, on the same data for the
//! same number of updates; errors are divided by NeRD's and drawn beside the paper's bars.
//!
//! Test case 1: contact-free passive motion of the double pendulum, 100 frames, mean of both joints; the data has its random
//! grounds. Test case 2: the shipped running policies of the Ant, and how far their rewards in a variant are from those in the
//! truth. Beside it stands passive motion of the Ant on its ground, for 20 frames.
//!
//! A finished variant is kept in `out/ablations` and not trained again. About half an hour on two cores.

use std::collections::HashSet;
use std::path::Path;

use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

mod bars;
mod figure;
mod guests;
mod rows;
mod tables;

use bars::{BARS, NERD};
pub use rows::{Measured, Row};

use super::Experiment;
use super::changes::{Change, chosen, each, model, moved};
use super::games::gap;
use crate::error::{Result, refuse};
use crate::report::{Input, Inputs, Table};
use guests::{Runner, runners};
use nerd_train::bounds::{SEEDS, STARTS, TRANSITIONS, UPDATES, figures};
use nerd_train::device::Device;
use nerd_train::evaluate::summary;
use nerd_train::run::RunConfig;
use nerd_train::settings::settings;
use nerd_train::shipped::root;

/// Where trained variants are kept.
const RUNS: &str = "out/ablations";
/// Windows in an update of NeRD.
const BATCH: usize = 64;
/// Seed of the games' starts.
const GAMES: u64 = 500;

settings! {
    /// The paper's ablations (Figure A.2).
    pub struct Ablations {
        /// Robots, comma-separated [default: pendulum,ant]
        robot: Vec<String> = vec!["pendulum".into(), "ant".into()], Texts;
        /// Variants beside NeRD, comma-separated, as their bars are called (`gru`, `abs-pred`, `h-1`) [default: all]
        only: Vec<String> = Vec::new(), Texts;
        /// Optimiser updates of each variant, at least 80, since a loss is noted every 20 and its fall is told by quarters
        updates: u64 = 1200, Whole(80..=*UPDATES.end());
        /// Transitions of the training data
        transitions: usize = 200_000, Whole(TRANSITIONS);
        /// Trajectories of the evaluation (the paper: 2048)
        starts: usize = 256, Whole(STARTS);
        /// Games of each running policy (the paper: 2048)
        games: usize = 128, Whole(STARTS);
        /// Seeds of data, weights and windows, comma-separated; bars are means over them [default: 0]
        seed: Vec<u64> = vec![0], Wholes(SEEDS);
        /// Where to compute: cpu or cuda
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// All variants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ablated {
    /// What was asked for.
    #[serde(flatten)]
    pub settings: Ablations,
    /// By robot and variant.
    pub rows: Vec<Row>,
}

/// Frames of a rollout: those of the paper's first test case; of the Ant, which loses the ground of knowing more than nothing
/// sooner after so short a training, a third of a second.
fn frames(robot: &str) -> usize {
    if robot == "ant" { 20 } else { 100 }
}

impl Ablations {
    /// Refuses what is none of the paper's test cases, and anything twice.
    fn check(&self) -> Result<()> {
        if let Some(robot) = self.robot.iter().find(|r| !["pendulum", "ant"].contains(&r.as_str())) {
            refuse!("--robot {robot}: the paper's test cases are of pendulum and ant");
        }
        let (robots, seeds): (HashSet<_>, HashSet<_>) = (self.robot.iter().collect(), self.seed.iter().collect());
        if robots.len() < self.robot.len() || seeds.len() < self.seed.len() {
            refuse!("--robot and --seed: each once");
        }
        Ok(())
    }

    /// How NeRD is trained; everything that decides a run's bytes stands in its folder's name.
    fn nerd(&self, robot: &str, seed: u64) -> Result<RunConfig> {
        let folder = format!("{robot}-updates{}-transitions{}-seed{seed}", self.updates, self.transitions);
        let mut run = RunConfig::recipe("quick", robot, root().join(RUNS).join(folder))?;
        (run.updates, run.transitions, run.batch, run.device) = (self.updates, self.transitions, BATCH, self.device);
        // The end of the run alone is looked at: the last weights, whose rate fell to zero, or their average.
        (run.validate_every, run.rollouts, run.record.seed) = (Some(self.updates), 32, seed);
        Ok(run)
    }

    /// What is trained, by robot, variant and seed.
    fn runs(&self) -> Result<Vec<(&'static Change, RunConfig)>> {
        let all: Vec<&Change> = BARS.iter().map(|bar| &bar.change).collect();
        let mut runs = Vec::new();
        for robot in &self.robot {
            for change in chosen(&all, &self.only, NERD)? {
                for seed in &self.seed {
                    runs.push((change, change.run(&self.nerd(robot, *seed)?)));
                }
            }
        }
        Ok(runs)
    }

    /// Rolls a run's model out, and lets policies run in the Ant's.
    fn measured(&self, run: &RunConfig, runners: &[Runner]) -> Result<Measured> {
        let system = System::named(&run.robot)?;
        let (loss, falling) = record(&run.out)?;
        let (model, mut learned) = model(run, &system, self.starts)?;
        let scales = model.normalizer.inputs.scale().filter(|s| *s > 0.01);
        let scales = scales.fold([f64::MAX, 0.0], |[a, b], s| [a.min(s), f64::max(b, s)]);
        let report = moved(&mut learned, &system, scene(&system), (self.starts, frames(&run.robot)))?;
        let folder = run.out.join("model");
        let share = |runner: &Runner| -> Result<f64> {
            let played = runner.play(&folder, run.device, self.games, GAMES)?;
            Ok(gap(played.real.mean, played.learned.mean).abs() / 100.0)
        };
        let gaps = if run.robot == "ant" { runners.iter().map(share).collect::<Result<Vec<f64>>>()? } else { Vec::new() };
        Ok(Measured {
            seed: run.record.seed,
            loss,
            falling,
            scales,
            error: summary(&system, &report.error),
            standard_error: summary(&system, &report.standard_error),
            one_frame: report.curve.first().copied().unwrap_or(0.0),
            diverged: report.diverged,
            gap: (!gaps.is_empty()).then(|| gaps.iter().sum::<f64>() / gaps.len() as f64),
            hold: summary(&system, &report.hold),
        })
    }
}

/// Where a robot's variants are rolled out.
fn scene(system: &System) -> &str {
    system.usual_scenes().first().copied().unwrap_or("free")
}

/// What a run's record says: validation loss, and [`Measured::falling`].
fn record(run: &Path) -> Result<(f64, f64)> {
    let path = run.join("metrics.jsonl");
    let text = std::fs::read_to_string(&path).map_err(crate::error::file(&path))?;
    let lines: Vec<serde_json::Value> =
        text.lines().map(serde_json::from_str).collect::<std::result::Result<_, _>>().map_err(crate::error::format(&path))?;
    let losses = |kind: &str| lines.iter().filter(|l| l["kind"] == kind).filter_map(|l| l["loss"].as_f64()).collect::<Vec<f64>>();
    let (train, validation) = (losses("train"), losses("validation").pop());
    let quarter = |k: usize| {
        let part = &train[k * train.len() / 4..(k + 1) * train.len() / 4];
        part.iter().sum::<f64>() / part.len() as f64
    };
    let Some(validation) = validation else { refuse!("{}: no validation loss; remove the run and train it anew", path.display()) };
    let falling = quarter(2) / quarter(3);
    figures(&format!("{}: fall of the training loss", path.display()), &[falling])?;
    Ok((validation, falling))
}

impl Experiment for Ablations {
    type Data = Ablated;

    fn name(&self) -> String {
        "ablations".into()
    }

    fn seed(&self) -> u64 {
        self.seed.first().copied().unwrap_or_default()
    }

    fn effort(&self) -> f64 {
        self.runs().map_or(0, |runs| runs.len()) as f64 * self.updates as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        self.check()?;
        let mut inputs = Inputs::default();
        for robot in &self.robot {
            let system = System::named(robot)?;
            inputs.add(Input::robot(&system));
            inputs.add(Input::motion(robot, scene(&system), &system.spec.truth.into())?);
        }
        if self.robot.iter().any(|r| r == "ant") {
            runners()?.iter().try_for_each(|path| Input::policy(path).map(|policy| inputs.add(policy)))?;
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Ablated> {
        self.check()?;
        let ant = self.robot.iter().any(|r| r == "ant");
        let paths = if ant { runners()? } else { Vec::new() };
        let runners = paths.into_iter().map(|path| Runner::new(path, self.games, GAMES)).collect::<Result<Vec<_>>>()?;
        let runs = self.runs()?;
        let measured = each(&runs, |_, run, config| Ok((config.clone(), self.measured(run, &runners)?)))?;
        // Seed after seed of a variant.
        let n = self.seed.len().max(1);
        let row = |(runs, all): (&[(&Change, RunConfig)], &[_])| Row::new(&runs[0].1.robot, runs[0].0.name, all);
        let rows: Vec<Row> = runs.chunks(n).zip(measured.chunks(n)).filter_map(row).collect();
        rows::check(&rows)?;
        Ok(Ablated { settings: self.clone(), rows })
    }

    fn tables(&self, data: &Ablated) -> Result<Vec<Table>> {
        Ok(tables::all(data))
    }

    fn pictures(&self, data: &Ablated, stem: &Path) -> Result<()> {
        figure::draw(&data.rows, stem)
    }
}
