//! Speed against accuracy on a GPU: the articulated solver and learned ones, whose batch never leaves it, and MuJoCo Warp where somebody has
//! it; and how far they are from the same solvers on the CPU.

mod figure;
mod learning;
mod pace;
mod parity;
mod race;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_model::folder::ModelConfig;
use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use learning::Learning;
pub use pace::Pace;
pub use parity::Parity;
pub use race::Race;

use super::Experiment;
use crate::choice::Choice;
use crate::error::{Result, refuse};
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};
use nerd_train::device::Device;
use nerd_train::ppo::Arena;
use nerd_train::progress::bar;
use nerd_train::shipped;

/// Frames after which most robots touch something.
const FALL: usize = 25;

/// The experiment.
#[derive(Clone, Debug)]
pub struct OnDevice {
    /// Name of the artefact.
    pub name: String,
    /// Robots with their scenes.
    pub robots: Vec<(String, String)>,
    /// Model folders; none stands for those that come with the project. Each takes part where its robot does.
    pub models: Vec<PathBuf>,
    /// States from which one frame is compared.
    pub states: usize,
    /// Rollouts whose error is measured.
    pub rollouts: usize,
    /// Environments of the timed batch.
    pub environments: usize,
    /// Substeps of the implicit step that are timed, and of the explicit one.
    pub substeps: [Vec<usize>; 2],
    /// Tasks whose training is timed, in the models of their robots.
    pub tasks: Vec<String>,
    /// Analytic settings that their training is timed in, too.
    pub beside: Vec<Setting>,
    /// Tasks that are learned for so many seconds, then played in the truth; with which seeds, and in which folder.
    pub races: Vec<(String, f64)>,
    /// See `races`.
    pub seeds: Vec<u64>,
    /// See `races`.
    pub runs: PathBuf,
    /// Python that has MuJoCo Warp, to ask that engine in.
    pub warp: Option<PathBuf>,
    /// Seed of the starts.
    pub seed: u64,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Data {
    /// One a robot and solver.
    pub parities: Vec<Parity>,
    /// One a robot and setting.
    pub paces: Vec<Pace>,
    /// One a task.
    pub learning: Vec<Learning>,
    /// One a policy.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub races: Vec<Race>,
    /// MuJoCo Warp's version, if it was asked in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warp: Option<String>,
}

impl OnDevice {
    /// Starts, each after a fall.
    fn starts(&self, system: &Arc<System>, scene: &str, n: usize) -> Result<Batch> {
        let mut batch = Batch::new(system, &system.scene(scene)?, n);
        let drawn: Vec<Vec<f64>> =
            (0..n as u64).into_par_iter().map(|env| start(system, Start::Sample, &mut stream(self.seed, env))).collect();
        drawn.iter().enumerate().for_each(|(env, state)| batch.reset(env, state));
        let (mut solver, torques) = (Articulated::new(ArticulatedConfig::accurate(system)), idle(&batch));
        (0..FALL).try_for_each(|_| solver.step(&mut batch, &torques))?;
        Ok(batch)
    }

    /// The models of a robot.
    fn models(&self, robot: &str) -> Result<Vec<Setting>> {
        if self.models.is_empty() {
            let own = shipped::models().join(robot);
            return Ok(own.join("config.json").exists().then_some(Setting::Neural(own)).into_iter().collect());
        }
        let mut models = Vec::new();
        for folder in &self.models {
            let of = ModelConfig::read(folder)?.robot;
            if of == robot {
                models.push(Setting::Neural(folder.clone()));
            } else if self.robots.iter().all(|(robot, _)| *robot != of) {
                let known: Vec<&str> = self.robots.iter().map(|(robot, _)| robot.as_str()).collect();
                refuse!("{} is a model of `{of}`; robots here are {}", folder.display(), known.join(", "));
            }
        }
        Ok(models)
    }

    /// All settings of a robot in a scene.
    fn settings(&self, robot: &str, contact: bool) -> Result<Vec<Setting>> {
        let [implicit, explicit] = &self.substeps;
        let mut settings: Vec<Setting> = implicit.iter().map(|n| Setting::Implicit(*n)).collect();
        let one = if contact { Setting::Euler } else { Setting::Rk4 };
        settings.extend(explicit.iter().map(|n| one(*n)));
        settings.extend(self.models(robot)?);
        Ok(settings)
    }
}

/// No torques.
fn idle(batch: &Batch) -> Vec<f64> {
    vec![0.0; batch.len() * batch.system.robot.joint_count()]
}

/// Whether a batch's robot can touch something.
fn touching(batch: &Batch) -> bool {
    !batch.system.robot.contact_points.is_empty() && batch.scenes.iter().any(|scene| !scene.colliders.is_empty())
}

impl Experiment for OnDevice {
    type Data = Data;

    fn name(&self) -> String {
        self.name.clone()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        let frames = self.robots.len() * (self.states + self.rollouts * pace::FRAMES + self.environments * pace::FRAMES);
        (frames + self.tasks.len() + self.races.len() * self.seeds.len()) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for (robot, scene) in &self.robots {
            inputs.add(Input::robot(&*System::named(robot)?));
            for setting in self.models(robot)?.into_iter().chain([Setting::Accurate]) {
                inputs.solver(&Choice::Setting(setting), robot, scene)?;
            }
        }
        for task in self.tasks.iter().chain(self.races.iter().map(|(task, _)| task)) {
            let robot = nerd_tasks::named(task)?.robot();
            inputs.add(Input::robot(&*System::named(robot)?));
            inputs.add(Input::model(&shipped::model_of_task(task, robot))?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Data> {
        let mut data = Data { parities: Vec::new(), paces: Vec::new(), learning: Vec::new(), races: Vec::new(), warp: None };
        let bar = bar("robots", self.robots.len() as u64);
        for (k, (robot, scene)) in self.robots.iter().enumerate() {
            let (system, of) = (System::named(robot)?, format!("{robot}, {scene}"));
            let batch = self.starts(&system, scene, self.states.max(self.rollouts))?;
            for setting in [Setting::Accurate].into_iter().chain(self.models(robot)?) {
                data.parities.push(parity::measure(&of, &setting, &batch)?);
            }
            let settings = self.settings(robot, touching(&batch))?;
            data.paces.extend(pace::measure(&of, &settings, &batch, self.rollouts, self.environments)?);
            if let Some(python) = &self.warp {
                let (version, guests) = pace::guests(&of, python, &batch, self.rollouts, self.environments)?;
                data.warp = Some(version);
                data.paces.extend(guests);
            }
            bar.set(k as u64 + 1);
        }
        for task in &self.tasks {
            let robot = nerd_tasks::named(task)?.robot();
            let mut arenas = vec![Arena::Model { folder: shipped::model_of_task(task, robot), device: Device::Cuda }];
            arenas.extend(self.beside.iter().map(|setting| Arena::Card(setting.clone())));
            for arena in &arenas {
                data.learning.push(learning::measure(task, arena, self.environments, self.seed)?);
            }
        }
        for (task, seconds) in &self.races {
            for seed in &self.seeds {
                data.races.push(race::run(task, *seconds, *seed, &self.runs)?);
            }
        }
        bar.finish();
        pace::mark(&mut data.paces);
        Ok(data)
    }

    fn tables(&self, data: &Data) -> Result<Vec<Table>> {
        let note = format!(
            "One frame from the same {} states, {FALL} frames after a start, under torques of up to a quarter of what each joint takes: difference of the device's state from the \
             CPU's, by number relative to 1 + its size; largest over the numbers of a state. Networks have 32 bits everywhere.",
            self.states
        );
        let header = [
            "robot, scene",
            "solver",
            "touching (%)",
            "64 bits, largest",
            "32 bits, largest",
            "32 bits, median",
            "32 bits, beyond 1e-4 (%)",
        ];
        let parities = Table::new("parity", &header).with(data.parities.iter().map(Parity::cells)).noted(&note);
        let guest = data.warp.as_ref().map_or_else(String::new, |version| {
            format!(
                " MuJoCo {version} is held against its own converged run, all others against ours; its time is that of its steps alone."
            )
        });
        let note = format!(
            "No torques. Error: mean distance of configurations from `converged` over {} frames, {} rollouts that begin where those above do. \
             Frames/s: {} environments together, on all cores of the CPU with 64 bits over ten frames, and on the device, which holds them for {} frames, with \
             32 bits; transfers there and back are counted. Lost: environments that were given up.{guest} Front (*): no other setting is faster and nearer to its reference.",
            pace::FRAMES,
            self.rollouts,
            self.environments,
            pace::FRAMES
        );
        let header = [
            "robot, scene",
            "solver",
            "error, CPU (rad, m)",
            "error, device",
            "frames/s, CPU",
            "frames/s, device",
            "us a frame",
            "lost",
            "front",
        ];
        let paces = Table::new("pace", &header).with(data.paces.iter().map(Pace::cells)).noted(&note);
        let note = "PPO in the shipped model of the task's robot, and in the analytic solver, updates included: frames, tasks, the policy's answers \
                    and its updates are all on the device. The paper's settings but for the number of environments.";
        let header = ["task", "solver", "environments", "steps an iteration", "steps/s", "rollout (%)", "update (%)", "memory (GiB)"];
        let learning = Table::new("learning", &header).with(data.learning.iter().map(Learning::cells)).noted(note);
        let note = "PPO in the shipped model of the task's robot, at the paper's settings, all of it on the device, stopped after so long; then 100 \
                    games under mean actions in the truth, on the CPU, and in the model. +-: standard errors.";
        let header = ["task", "seed", "seconds of training", "environments", "steps", "reward in the truth", "reward in NeRD", "gap (%)"];
        let races = Table::new("races", &header).with(data.races.iter().map(Race::cells)).noted(note);
        Ok([parities, paces, learning, races].into_iter().filter(|table| !table.rows.is_empty()).collect())
    }

    fn pictures(&self, data: &Data, stem: &Path) -> Result<()> {
        for (robot, scene) in &self.robots {
            let shown: Vec<&Pace> = data.paces.iter().filter(|p| p.of == format!("{robot}, {scene}")).collect();
            figure::figure(&shown, self.environments).save(&stem.with_file_name(format!("{}-{robot}-{scene}", self.name)))?;
        }
        Ok(())
    }
}

/// A number, or that there is none.
fn cell(x: Option<f64>) -> String {
    x.map_or_else(|| "-".into(), digits)
}
