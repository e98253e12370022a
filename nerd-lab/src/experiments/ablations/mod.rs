//! The paper's Figure A.2: NeRD is trained beside itself with one design decision taken back at a time, on the same data for the
//! same number of updates; errors are divided by NeRD's and shown beside the paper's bars.
//!
//! Test case 1: contact-free passive motion of the double pendulum, 100 frames, mean of both joints; the data has its random
//! grounds. Test case 2: the shipped running policies of the Ant, and how far their rewards in a variant are from those in the
//! truth. Beside it: passive motion of the Ant on its ground, for 20 frames.
//!
//! A finished variant is kept in `out/ablations` and not trained again. About half an hour on two cores.

mod bars;
mod rows;

use std::collections::HashSet;

use nerd_train::bounds::{BATCH, TRANSITIONS, UPDATES};
use nerd_train::evaluate::summary;
use nerd_train::ppo::folder;
use nerd_train::run::{Run, RunConfig};
use nerd_train::shipped::{policies, root};

use super::games::{Reward, games, gap};
use crate::prelude::*;
use bars::{BARS, Bar, NERD};
use rows::{Measurement, Row};

const RUNS: &str = "out/ablations";
/// Seed of the starts of rollouts and games, and the task that policies run.
const STARTED: u64 = 500;
const TASK: &str = "ant-run";

settings! {
    /// The paper's ablations (Figure A.2).
    pub struct Ablations {
        /// Robots, comma-separated [default: pendulum,ant]
        robot: Vec<String> = vec!["pendulum".into(), "ant".into()], Texts;
        /// Variants beside NeRD, comma-separated, as their bars are called (`gru`, `abs-pred`, `h-1`) [default: all]
        only: Vec<String> = Vec::new(), Texts;
        /// Optimiser updates of each variant
        updates: u64 = 1200, Whole(100..=*UPDATES.end());
        /// Windows in an update of NeRD
        batch: usize = 64, Whole(BATCH);
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

/// Frames of a rollout: those of the paper's first test case; of the Ant, which sooner knows no more than one who repeats the
/// start after so short a training, a third of a second.
fn frames(robot: &str) -> usize {
    if robot == "ant" { 20 } else { 100 }
}

fn first_scene(system: &System) -> &str {
    system.usual_scenes().first().copied().unwrap_or("free")
}

impl Ablations {
    /// Refuses robots that the paper has no test case of, and anything twice.
    fn check(&self) -> Result<()> {
        if let Some(robot) = self.robot.iter().find(|r| !["pendulum", "ant"].contains(&r.as_str())) {
            bail!("robot {robot}: the paper's test cases are of pendulum and ant");
        }
        let (robots, seeds): (HashSet<_>, HashSet<_>) = (self.robot.iter().collect(), self.seed.iter().collect());
        if robots.len() < self.robot.len() || seeds.len() < self.seed.len() {
            bail!("robot and seed: each once");
        }
        let slugs = BARS.each_ref().map(Bar::slug);
        match self.only.iter().find(|name| !slugs.contains(name)) {
            Some(name) => bail!("only {name}: choose from {}", slugs.join(", ")),
            None => Ok(()),
        }
    }

    /// The running policies that come with the project, where the Ant is asked for.
    fn runners(&self) -> Result<Vec<PathBuf>> {
        if self.robot.iter().all(|robot| robot != "ant") {
            return Ok(Vec::new());
        }
        let found = policies(&format!("{TASK}-neural-"))?;
        if found.is_empty() {
            bail!("models/policies has no {TASK}-neural-*: train one with `cargo xtask policy train {TASK} --solver neural`");
        }
        Ok(found)
    }

    fn bars(&self) -> impl Iterator<Item = &'static Bar> {
        BARS.iter().filter(|bar| self.only.is_empty() || bar.name == NERD || self.only.contains(&bar.slug()))
    }

    /// How NeRD is trained; everything that decides a run's bytes is in its folder's name.
    fn nerd(&self, robot: &str, seed: u64) -> Result<RunConfig> {
        let folder = format!("{robot}-updates{}-batch{}-transitions{}-seed{seed}", self.updates, self.batch, self.transitions);
        let mut run = RunConfig::recipe("quick", robot, root().join(RUNS).join(folder))?;
        (run.updates, run.transitions, run.batch, run.device) = (self.updates, self.transitions, self.batch, self.device);
        // The end of the run alone is looked at: the last weights, whose rate fell to zero, or their average.
        (run.validate_every, run.rollouts, run.record.seed) = (Some(self.updates), 32, seed);
        Ok(run)
    }

    fn reward(&self, policy: &Path, arena: &Arena) -> Result<f64> {
        Ok(Reward::of(&games(TASK, arena, &folder::load(policy)?.1, self.games, STARTED)?).mean)
    }

    /// What stands below a robot's table.
    fn note(&self, robot: &str, hold: &str) -> String {
        let (frames, Self { updates, batch, starts, games, seed, .. }) = (frames(robot), self);
        let case = match robot {
            "ant" => format!(
                "The paper's test case: running policies, {games} games of each; the gap is |reward in the variant - in the truth| over the latter, \
                 mean over policies. Error: passive motion on the ground for {frames} frames, position (m) / orientation / joints (rad)."
            ),
            _ => format!("Error: contact-free passive motion for {frames} frames, joints (rad)."),
        };
        format!(
            "{robot}: NeRD with one decision taken back. Same data, {updates} updates of {batch} windows, networks of equal parameter counts, Muon for \
             hidden matrices and Adam for the rest; seeds {seed:?}. {case} {starts} starts; NeRD is `{NERD}`. A predictor that repeats the start: {hold}."
        )
    }

    /// Trains a run unless its model is there, rolls the model out, and lets policies run in the Ant's; `truth` has their rewards.
    fn measured(&self, run: &RunConfig, truth: &[(PathBuf, f64)]) -> Result<(ModelConfig, Measurement)> {
        let folder = run.out.join("model");
        if !folder.join("config.json").exists() && Run::new(run)?.train()?.is_none() {
            bail!("{}: training did not finish; the same command continues it", run.out.display());
        }
        let system = System::named(&run.robot)?;
        let model = Model::load(&folder, &system, Some(&run.record.truth(&system).name()))?;
        let mut learned = run.device.solver(model, &system, self.starts)?;
        let protocol = PassiveConfig { starts: self.starts, steps: frames(&run.robot), seed: STARTED, action: Action::Zero };
        let scene = system.scene(first_scene(&system))?;
        let report = passive(&system, &scene, &mut *system.spec.truth.solver(&system), &mut learned, protocol, &mut |_| ())?;
        let arena = Arena::Model { folder: folder.clone(), device: run.device };
        let share = |(policy, real): &(PathBuf, f64)| Ok(gap(*real, self.reward(policy, &arena)?).abs() / 100.0);
        let gaps = if run.robot == "ant" { truth.iter().map(share).collect::<Result<Vec<f64>>>()? } else { Vec::new() };
        let measurement = Measurement {
            seed: run.record.seed,
            error: summary(&system, &report.error),
            one_frame: report.curve.first().copied().unwrap_or(0.0),
            diverged: report.diverged,
            gap: (!gaps.is_empty()).then(|| gaps.iter().sum::<f64>() / gaps.len() as f64),
            hold: summary(&system, &report.hold),
        };
        Ok((ModelConfig::read(&folder)?, measurement))
    }
}

impl Experiment for Ablations {
    fn about(&self) -> Result<About> {
        self.check()?;
        let mut inputs = Inputs::default();
        for robot in &self.robot {
            let system = System::named(robot)?;
            inputs.add(Input::robot(&system));
            inputs.add(Input::motion(robot, first_scene(&system), &system.spec.truth.into())?);
        }
        self.runners()?.iter().try_for_each(|path| Input::policy(path).map(|policy| inputs.add(policy)))?;
        let effort = (self.robot.len() * self.seed.len() * self.bars().count()) as f64 * self.updates as f64;
        Ok(About { name: "ablations".into(), seed: self.seed.first().copied().unwrap_or_default(), effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        self.check()?;
        let real = |path: PathBuf| self.reward(&path, &Arena::Truth(Truth::Articulated)).map(|reward| (path, reward));
        let truth = self.runners()?.into_iter().map(real).collect::<Result<Vec<_>>>()?;
        let mut rows = Vec::new();
        for robot in &self.robot {
            for bar in self.bars() {
                let mut trained = Vec::new();
                for seed in &self.seed {
                    tell!("{robot}, {}, seed {seed}", bar.name);
                    trained.push(self.measured(&bar.run(&self.nerd(robot, *seed)?), &truth)?);
                }
                rows.extend(Row::new(robot, bar, &trained));
            }
        }
        rows::check(&rows)?;
        let tables = self.robot.iter().map(|robot| rows::table(&rows, robot).noted(&self.note(robot, &rows::hold(&rows, robot)))).collect();
        Ok(Measured::new(&serde_json::json!({ "settings": self, "rows": &rows }), tables)?.with("figure", rows::figure(&rows, &self.robot)))
    }
}
