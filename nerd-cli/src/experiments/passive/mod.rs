//! Passive motion (the verb `evaluate`): drift of a solver from the truth, and of a model from its own truth.
//!
//! [`nerd_train::evaluate`] rolls out without torques from the robot's reset distribution. An error is the mean
//! absolute difference of a coordinate over all steps and trajectories. Listed beside them are the error `hold` of
//! repeating the start, the paper's error and the number of diverged rollouts. A paper-size network takes about 0.5 ms
//! per environment and frame on two cores, a tenth if it streams.

mod recorded;
mod rows;

use nerd_sim::instruments::Shaken;
use nerd_train::verdict::{Verdict, verdict};

use crate::{
    describe::{bytes, title},
    error::unused,
    paper,
    prelude::*,
};

pub use recorded::Recorded;
pub use rows::{Row, Rows};

settings! {
    /// Settings of passive motion: options of `evaluate`.
    pub struct Protocol {
        /// Scenes, comma-separated [default: the scene of the robot's training data, else all of its own scenes]
        scene: Vec<String> = Vec::new(), Texts;
        /// Number of trajectories (the paper: 2048); with --data at most this many rollouts
        trajectories: usize = 256, Whole(STARTS);
        /// Frames of a trajectory [default: as in the paper, 1000 for cartpole, 500 for ant and anymal, else 100]
        frames: Option<usize> = None, Whole(FRAMES);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Factor on random torques, drawn as in the training data. With 0, motion is passive
        torque_scale: f64 = 0.0, Number(0.0..=1e3);
        /// Standard deviation (rad/s or m/s) of normal noise on all velocities after every frame of the solver. With
        /// the truth as the solver, this shows how much the motion itself amplifies small differences
        velocity_noise: f64 = 0.0, Number(0.0..=1e3);
        /// Trajectories on which a model is compared with its base alone, a linear map and the analytic solver. The
        /// comparison runs on one CPU core; 0 skips it
        verdict: usize = 32, Whole(0..=*STARTS.end());
        /// Recorded motion to compare a model with: a log's TOML, or a folder with `log.toml`. Only its held-out
        /// trajectories are used [default: simulated motion]
        data: Option<PathBuf> = None, Text;
        /// With --data: frames that a model sees before each rollout [default: as many as a prediction depends on]
        context_frames: Option<usize> = None, Whole(0..=*FRAMES.end());
        /// With --data: frames between starts [default: those of a rollout]
        every: Option<usize> = None, Whole(FRAMES);
        /// With --data: a second log (its TOML or folder), by another simulator or with other steps. Its trajectories
        /// begin at frames of held-out trajectories, and rollouts start there. Its errors are listed beside the model's
        /// [default: none]
        beside: Option<PathBuf> = None, Text;
        /// With --data: evaluations of the objective that calibrates the analytic solver. With 0, only the solver as
        /// described is compared
        evaluations: usize = 300, Whole(0..=1_000_000);
    }
}

#[derive(Clone)]
pub struct Case {
    pub robot: String,
    pub solver: SolverSpec,
    /// Truth that the solver is compared with. `None` stands for the truth that a model learned, or else the robot's
    /// own.
    pub truth: Option<Truth>,
    pub asked: Protocol,
}

impl Case {
    /// Cases of all shipped models, ordered by robot.
    pub fn shipped(asked: &Protocol, device: Device) -> Result<Vec<Self>> {
        let mut models = Vec::new();
        for folder in shipped::folders(&shipped::models(), "")? {
            let robot = ModelConfig::read(&folder)?.robot;
            let place = System::built_in().iter().position(|known| *known == robot).unwrap_or(usize::MAX);
            models.push((place, robot, folder));
        }
        if models.is_empty() {
            bail!("models/ holds no model: train one with `cargo xtask train`, or name one with --model");
        }
        models.sort();
        let case = |(_, robot, folder): (usize, String, PathBuf)| {
            let mut asked = asked.clone();
            // Takes a quarter of the trajectories: rapier as a truth costs a hundred times as much as `articulated`.
            if ModelConfig::truth_of(&folder)? == Truth::Rapier {
                asked.trajectories = asked.trajectories.div_ceil(4);
            }
            // Franka holds still without torques, so its model is tested under random torques.
            if robot.starts_with("franka") {
                asked.torque_scale = 1.0;
            }
            Ok(Self { robot, solver: SolverSpec::neural(folder).on(device), truth: None, asked })
        };
        models.into_iter().map(case).collect()
    }
}

pub struct Passive {
    name: String,
    seed: u64,
    asked: Vec<Asked>,
}

/// A case in one scene, with its names resolved.
struct Asked {
    case: Case,
    system: Arc<System>,
    scene: Arc<Scene>,
    truth: Truth,
    method: String,
    protocol: PassiveConfig,
}

impl Passive {
    /// Resolves the robots, scenes and solvers that the cases name. The cases share one seed; `name` is the result's.
    pub fn new(name: &str, cases: &[Case]) -> Result<Self> {
        let mut asked = Vec::new();
        for case in cases {
            let given = &case.asked;
            let idle = [
                ("--context-frames", given.context_frames.is_some()),
                ("--every", given.every.is_some()),
                ("--beside", given.beside.is_some()),
                ("--evaluations", given.evaluations != Protocol::default().evaluations),
            ];
            unused(&idle, "without --data")?;
            let system = System::named(&case.robot)?;
            let mut scenes = given.scene.iter().map(String::as_str).collect_vec();
            if scenes.is_empty() {
                scenes = system.usual_scenes();
            }
            let learned = case.solver.folder().map(ModelConfig::truth_of).transpose()?;
            let truth = case.truth.or(learned).unwrap_or(system.spec.truth);
            let steps = given.frames.unwrap_or_else(|| nerd_train::evaluate::horizon(&system.name));
            let action = if given.torque_scale == 0.0 { Action::Zero } else { Action::Random(given.torque_scale) };
            let protocol = PassiveConfig { starts: given.trajectories, steps, seed: given.seed, action };
            for scene in scenes {
                let mut method = title(&case.solver)?;
                if given.velocity_noise != 0.0 {
                    method += &format!(", shaken by {}", given.velocity_noise);
                }
                let scene = system.scene(scene)?;
                check(case, truth, &system, &scene, steps)?;
                asked.push(Asked { case: case.clone(), system: system.clone(), scene, truth, method, protocol });
            }
        }
        Ok(Self { name: name.into(), seed: cases.first().map_or(0, |case| case.asked.seed), asked })
    }

    pub fn rows(&self) -> Result<Rows> {
        let bar = bar("rollout frames", self.asked.iter().map(|a| a.work() as u64).sum());
        let mut done = 0;
        let mut rows = Vec::new();
        for asked in &self.asked {
            bar.say(&format!("{} in {}", asked.system.name, asked.scene.name));
            let row = asked.measure(&mut |step| bar.set((done + step * asked.protocol.starts) as u64))?;
            if row.report.error.iter().all(|error| *error == 0.0) {
                let Row { method, truth, robot, scene, .. } = &row;
                tell!(
                    "note: `{method}` moves {robot} in {scene} as `{truth}` to the bit: nothing that its settings change acts there"
                );
            }
            rows.push(row);
            done += asked.work();
        }
        bar.finish();
        for (asked, row) in self.asked.iter().zip(&mut rows) {
            // Reports a verdict that fails, and keeps its row.
            let found = asked.verdict().inspect_err(|error| tell!("{}: no verdict: {error:#}", asked.system.name));
            row.verdict = found.unwrap_or_default();
        }
        Ok(Rows { rows })
    }
}

/// Refuses a comparison of a solver with itself, and more work or memory than `bounds` permits.
fn check(case: &Case, truth: Truth, system: &System, scene: &Scene, steps: usize) -> Result<()> {
    let trajectories = case.asked.trajectories;
    if case.solver.moves_as(&truth.into(), system, scene) && case.asked.velocity_noise == 0.0 {
        bail!(
            "`{}` against itself is 0 everywhere; name what to measure: --solver neural, rapier or articulated(substeps=N), \
             or --velocity-noise",
            truth.name()
        );
    }
    // Bytes per trajectory: two batches with what their solvers keep, sums over steps, working memory of the truth.
    let bytes = bytes(&case.solver)?.saturating_add(1024 * system.robot.state_dim());
    bounds::memory(&[("--trajectories", trajectories)], bytes)?;
    let substeps = case.solver.substeps(system).max(system.spec.substeps);
    Ok(bounds::time(&[("--trajectories", trajectories), ("--frames", steps), ("substeps", substeps)])?)
}

impl Asked {
    fn measure(&self, progress: &mut dyn FnMut(usize)) -> Result<Row> {
        let Self { case, system, scene, truth, method, protocol } = self;
        let mut solver = case.solver.solver(system, protocol.starts)?;
        if case.asked.velocity_noise > 0.0 {
            solver = Box::new(Shaken::new(solver, case.asked.velocity_noise, protocol.seed));
        }
        let report = passive(system, scene, &mut *truth.solver(system), &mut *solver, *protocol, progress)?;
        let whose = |what: &str| format!("{method} on {} in {}: its {what}", system.name, scene.name);
        bounds::figures(&whose("error"), report.error.iter().chain(&report.standard_error).chain(&report.curve))?;
        bounds::figures(&whose("hold-last error"), &report.hold)?;
        Ok(Row {
            // The paper's errors are against the reference simulator, so they appear beside that truth only.
            paper: paper::passive_error(&system.name, &scene.name).filter(|_| *truth == Truth::Paper),
            robot: system.name.clone(),
            method: method.clone(),
            model: case.solver.folder().map(shipped::from_root),
            scene: scene.name.clone(),
            truth: truth.name(),
            protocol: *protocol,
            report,
            verdict: None,
        })
    }

    /// Computes the model's verdict against its own truth; `None` for perturbed solvers and other truths.
    fn verdict(&self) -> Result<Option<Verdict>> {
        let Self { case, system, scene, truth, protocol, .. } = self;
        let Some(folder) = case.solver.folder() else { return Ok(None) };
        let model = Model::load(folder, system, None)?;
        if case.asked.verdict == 0 || case.asked.velocity_noise > 0.0 || model.config.truth != truth.name() {
            return Ok(None);
        }
        let protocol = PassiveConfig { starts: protocol.starts.min(case.asked.verdict), ..*protocol };
        Ok(verdict(system, scene, &model, protocol)?)
    }

    fn work(&self) -> usize {
        self.protocol.starts * self.protocol.steps
    }
}

impl Experiment for Passive {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        for Asked { case, system, scene, truth, .. } in &self.asked {
            inputs.add(Input::robot(system));
            inputs.add(Input::motion(&case.robot, &scene.name, &(*truth).into())?);
            inputs.solver(&case.solver, &case.robot, &scene.name)?;
        }
        let effort = self.asked.iter().map(|a| a.work() as f64).sum();
        Ok(About { name: self.name.clone(), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let rows = self.rows()?;
        let tables = [rows.table(), rows.summary()].into_iter().chain(rows.verdicts());
        Measured::new(&rows, tables.collect())
    }
}
