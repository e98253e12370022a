//! Passive motion: how far solvers drift from the truth, a model from the one it learned.
//!
//! Mean over every step and every trajectory of the absolute difference by coordinate, from the robot's reset law, without
//! torques; beside it the floors `hold` and `glide`, the paper's figure and the count of diverged rollouts. A paper-size
//! network takes some half a millisecond an environment-frame on two cores if it recomputes windows, a tenth of that if it
//! streams. The truth against itself is 0 everywhere and is asked for by name, as `control`.

use std::sync::Arc;

use nerd_model::folder::ModelConfig;
use nerd_sim::instruments::Shaken;
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::Experiment;
use crate::choice::Choice;
use crate::device::Device;
use crate::error::{Result, refuse};
use crate::evaluate::{Action, PassiveConfig, PassiveReport, passive, summary, summary_names};
use crate::report::table::{digits, pair};
use crate::report::{Input, Inputs, Table};
use crate::stats::mean;
use crate::{bounds, paper, progress, shipped};

/// Robots and the names of their models in `models/`, the first of them the one meant where none is named.
const MODELS: [(&str, &[&str]); 6] = [
    ("cartpole", &["cartpole"]),
    ("pendulum", &["pendulum", "pendulum-small", "pendulum-paper", "pendulum-rapier"]),
    ("cube", &["cube", "cube-rapier"]),
    ("franka", &["franka"]),
    ("ant", &["ant", "ant-rapier"]),
    ("anymal", &["anymal"]),
];

/// One solver of one robot in some of its scenes.
#[derive(Clone, Debug)]
pub struct Case {
    /// Robot, as [`System::named`] knows it.
    pub robot: String,
    /// Scenes; none stands for all of the robot's.
    pub scenes: Vec<String>,
    /// What is measured.
    pub solver: Choice,
    /// What it is held against; none stands for what a model learned, else `articulated`.
    pub truth: Option<Truth>,
    /// Trajectories by scene (the paper: 2048).
    pub starts: usize,
    /// Frames; none stands for the paper's, 1000 for Cartpole, 100 for the pendulum.
    pub steps: Option<usize>,
    /// What drives the joints.
    pub action: Action,
    /// Noise (rad/s or m/s) on all velocities after every frame of the solver.
    pub shake: f64,
    /// The truth against itself: every error must be 0.
    pub control: bool,
}

impl Default for Case {
    fn default() -> Self {
        Self {
            robot: "pendulum".into(),
            scenes: Vec::new(),
            solver: Choice::model(shipped::model(Truth::Articulated, "pendulum")),
            truth: None,
            starts: 256,
            steps: None,
            action: Action::Zero,
            shake: 0.0,
            control: false,
        }
    }
}

impl Case {
    /// The models that come with the project, over so many starts.
    ///
    /// # Errors
    /// If one of them cannot be read.
    pub fn shipped(starts: usize, device: Device) -> Result<Vec<Self>> {
        let mut cases = Vec::new();
        for (robot, folder) in MODELS.iter().flat_map(|(robot, names)| names.iter().map(move |name| (*robot, shipped::models().join(name))))
        {
            // rapier as a truth costs a hundred times what ours does.
            let starts = if ModelConfig::truth_of(&folder)? == Truth::default() { starts } else { starts.div_ceil(4) };
            // A held arm does not move: Franka's model is for driven ones.
            let action = if robot == "franka" { Action::Random(1.0) } else { Action::Zero };
            let solver = Choice::Neural { folder, truth: None, device };
            cases.push(Self { robot: robot.into(), solver, starts, action, ..Self::default() });
        }
        Ok(cases)
    }
}

/// Some solvers' errors.
pub struct Passive {
    name: String,
    seed: u64,
    asked: Vec<Asked>,
}

/// A case in one scene, with all that it names found.
struct Asked {
    case: Case,
    system: Arc<System>,
    scene: Arc<Scene>,
    truth: Truth,
    method: String,
    protocol: PassiveConfig,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Rows {
    /// A scene each.
    pub rows: Vec<Row>,
}

/// One scene's errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Robot.
    pub robot: String,
    /// Solver, of a learned one form and size.
    pub method: String,
    /// Folder of a learned one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Scene.
    pub scene: String,
    /// What it is held against.
    pub truth: String,
    /// Trajectories and frames.
    pub protocol: PassiveConfig,
    /// Errors and floors.
    pub report: PassiveReport,
    /// What the paper says, whose truth is `articulated`.
    pub paper: Option<Vec<f64>>,
}

impl Passive {
    /// Finds all that the cases name; a result called `name`, of starts with this seed.
    ///
    /// # Errors
    /// If a robot, scene, model or chart is not there, a case says nothing, or asks for more than can be borne.
    pub fn new(name: &str, seed: u64, cases: &[Case]) -> Result<Self> {
        let mut asked = Vec::new();
        for case in cases {
            let system = System::named(&case.robot)?;
            let usual = || system.usual_scenes().into_iter().map(String::from).collect();
            let scenes: Vec<String> = if case.scenes.is_empty() { usual() } else { case.scenes.clone() };
            let learned = case.solver.learned()?;
            let truth = case.truth.or(learned).unwrap_or_default();
            let steps = case.steps.unwrap_or_else(|| paper::horizon(&system.name));
            let protocol = PassiveConfig { starts: case.starts, steps, seed, action: case.action };
            let method = match case.shake {
                _ if case.control => format!("{}, control", case.solver.title(&system)?),
                0.0 => case.solver.title(&system)?,
                by => format!("{}, shaken by {by}", case.solver.title(&system)?),
            };
            let found = scenes.iter().map(|s| system.scene(s)).collect::<Result<Vec<_>, _>>()?;
            for scene in found {
                let case = Case { solver: case.solver.in_scene(&system, &scene.name)?, ..case.clone() };
                check(&case, truth, &system, steps)?;
                asked.push(Asked { case, system: system.clone(), scene, truth, method: method.clone(), protocol });
            }
        }
        Ok(Self { name: name.into(), seed, asked })
    }
}

/// Refuses what says nothing, and what is more than can be borne.
fn check(case: &Case, truth: Truth, system: &System, steps: usize) -> Result<()> {
    let itself = case.solver.is(truth, system);
    if itself && case.shake == 0.0 && !case.control {
        refuse!(
            "`{}` against itself is 0 everywhere; name what to measure: --solver neural or rapier, --preset, --friction or --substeps, \
             --tolerance, --shake; or --control for the zeros",
            truth.name()
        );
    }
    if case.control && (!itself || case.shake > 0.0) {
        refuse!("--control holds the truth `{}` against itself: leave out what names or shakes another solver", truth.name());
    }
    // Two batches with what their solvers keep, sums over steps, working memory of the truth.
    let bytes = case.solver.bytes()?.saturating_add(1024 * system.robot.state_dim());
    bounds::memory(&[("--starts", case.starts)], bytes)?;
    bounds::time(&[("--starts", case.starts), ("--frames", steps), ("substeps", case.solver.substeps().max(system.spec.substeps))])
}

impl Asked {
    fn measure(&self, progress: &mut dyn FnMut(usize)) -> Result<Row> {
        let Self { case, system, scene, truth, method, protocol } = self;
        let mut solver = case.solver.build(system, &scene.name, case.starts)?;
        if case.shake > 0.0 {
            solver = Box::new(Shaken::new(solver, case.shake, protocol.seed));
        }
        let report = passive(system, scene, &mut *truth.solver(system), &mut *solver, *protocol, progress)?;
        let whose = |what: &str| format!("{method} on {} in {}: its {what}", system.name, scene.name);
        bounds::figures(&whose("error"), report.error.iter().chain(&report.standard_error).chain(&report.curve))?;
        bounds::figures(&whose("hold-last or constant-velocity error"), report.hold.iter().chain(&report.glide))?;
        // What is no solver's error has nothing to stand beside.
        let comparable = *truth == Truth::Articulated && !case.control;
        let folder = match &case.solver {
            Choice::Neural { folder, .. } => Some(shipped::from_root(folder)),
            _ => None,
        };
        Ok(Row {
            robot: system.name.clone(),
            method: method.clone(),
            model: folder,
            scene: scene.name.clone(),
            truth: truth.name(),
            protocol: *protocol,
            report,
            paper: paper::passive_error(&system.name, &scene.name).filter(|_| comparable),
        })
    }

    fn work(&self) -> usize {
        self.protocol.starts * self.protocol.steps
    }
}

impl Experiment for Passive {
    type Data = Rows;

    fn name(&self) -> String {
        self.name.clone()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        self.asked.iter().map(|a| a.work() as f64).sum()
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for Asked { case, system, scene, truth, .. } in &self.asked {
            inputs.add(Input::robot(system));
            inputs.add(Input::motion(&case.robot, &scene.name, &(*truth).into())?);
            case.solver.inputs(&case.robot, &scene.name, &mut inputs)?;
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Rows> {
        let bar = progress::bar("rollout frames", self.asked.iter().map(|a| a.work() as u64).sum());
        let (mut done, mut rows) = (0, Vec::new());
        for asked in &self.asked {
            bar.say(&format!("{} in {}", asked.system.name, asked.scene.name));
            rows.push(asked.measure(&mut |step| bar.set((done + step * asked.protocol.starts) as u64))?);
            done += asked.work();
        }
        bar.finish();
        Ok(Rows { rows })
    }

    fn tables(&self, data: &Rows) -> Result<Vec<Table>> {
        Ok(vec![data.table(), data.summary()])
    }
}

impl Rows {
    /// All of it.
    pub fn table(&self) -> Table {
        let header = [
            "robot",
            "method",
            "scene",
            "starts x steps",
            "error (rad or m)",
            "standard error",
            "paper",
            "hold last",
            "constant velocity",
            "diverged",
        ];
        let cells = self.rows.iter().map(|r| {
            let p = &r.report;
            vec![
                r.whose(),
                r.method.clone(),
                r.scene.clone(),
                format!("{} x {}{}", r.protocol.starts, r.protocol.steps, r.driven()),
                r.shown(&p.error),
                r.shown(&p.standard_error),
                r.paper.as_deref().map_or_else(|| "-".into(), pair),
                r.shown(&p.hold),
                r.shown(&p.glide),
                p.diverged.to_string(),
            ]
        });
        Table::new("passive", &header).with(cells).noted(
            "Mean |dq| over all frames and trajectories, by joint; of more than two joints the mean, before it position (m) and \
             orientation (rad) of a floating base. The truth is `articulated paper coulomb` where none is named.",
        )
    }

    /// The model meant where none is named, of each robot and truth; of a robot's grounds the one with the largest error.
    pub fn summary(&self) -> Table {
        let usual = |r: &&Row| {
            let default = |truth: Truth| shipped::from_root(&shipped::model(truth, &r.robot));
            r.model.as_ref().is_none_or(|m| Truth::named(&r.truth).is_ok_and(|truth| default(truth) == *m))
        };
        let mut rows: Vec<&Row> = self.rows.iter().filter(usual).collect();
        if rows.is_empty() {
            rows = self.rows.iter().collect();
        }
        let same = |a: &Row, b: &Row| (&a.robot, &a.method, &a.truth) == (&b.robot, &b.method, &b.truth) && a.touches() == b.touches();
        let lines = rows.chunk_by(|a, b| same(a, b)).filter_map(|grounds| {
            let r = *grounds.iter().max_by(|a, b| mean(&a.report.error).total_cmp(&mean(&b.report.error)))?;
            let n = grounds.len();
            let scene = if n > 1 { format!("{}, the largest of {n}", r.scene) } else { r.scene.clone() };
            Some(vec![
                r.whose(),
                scene + &r.driven(),
                System::named(&r.robot).map_or_else(|_| String::new(), |system| summary_names(&system).join(" / ")),
                r.bounded(),
                r.paper.as_deref().map_or_else(|| "-".into(), pair),
                r.shown(&r.report.hold),
            ])
        });
        let lines: Vec<_> = lines.collect();
        Table::new("summary", &["robot", "scene", "mean error of", "NeRD (± standard error)", "paper", "hold last"]).with(lines)
    }
}

impl Row {
    fn shown(&self, figures: &[f64]) -> String {
        pair(&self.summary(figures))
    }

    fn summary(&self, figures: &[f64]) -> Vec<f64> {
        System::named(&self.robot).map_or_else(|_| figures.to_vec(), |system| summary(&system, figures))
    }

    /// Errors, each with its standard error.
    fn bounded(&self) -> String {
        let (error, spread) = (self.summary(&self.report.error), self.summary(&self.report.standard_error));
        let two = |s: f64| format!("{s:.*}", (1 - s.log10().floor().max(-9.0) as i32).max(0) as usize);
        let shown = |s: f64| if s > 0.0 { two(s) } else { s.to_string() };
        error.iter().zip(&spread).map(|(e, s)| format!("{} ± {}", digits(*e), shown(*s))).collect::<Vec<_>>().join(" / ")
    }

    fn whose(&self) -> String {
        if self.truth == Truth::Articulated.name() { self.robot.clone() } else { format!("{} ({})", self.robot, self.truth) }
    }

    fn driven(&self) -> String {
        match self.protocol.action {
            Action::Zero => String::new(),
            Action::Limp => ", limp".into(),
            Action::Random(factor) => format!(", torques x {factor}"),
        }
    }

    fn touches(&self) -> bool {
        self.scene != "free"
    }
}
