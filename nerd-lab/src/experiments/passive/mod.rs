//! Passive motion: how far solvers drift from the truth, and a model from its own.
//!
//! Mean over every step and every trajectory of the absolute difference by coordinate, from the robot's reset law, without
//! torques; beside it the floor `hold`, the paper's figure and the count of diverged rollouts. A paper-size
//! network takes some half a millisecond an environment-frame on two cores if it recomputes windows, a tenth of that if it
//! streams.

mod recorded;
mod rows;

use nerd_sim::instruments::Shaken;
use nerd_train::verdict::{Verdict, verdict};

use crate::{choice::Choice, error::unused, paper, prelude::*};

pub use recorded::Recorded;
pub use rows::{Row, Rows, unworthy};

settings! {
    /// How passive motion is measured.
    pub struct Protocol {
        /// Scenes, comma-separated [default: all of the robot's]
        scene: Vec<String> = Vec::new(), Texts;
        /// Trajectories (the paper: 2048)
        starts: usize = 256, Whole(STARTS);
        /// Frames [default: the paper's, 1000 for Cartpole, 100 for the pendulum]
        frames: Option<usize> = None, Whole(FRAMES);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Factor on the random torques of the training data, instead of passive motion
        drive: f64 = 0.0, Number(0.0..=1e3);
        /// Noise (rad/s or m/s) on all velocities after every frame of the solver. With the truth itself as the solver, this shows how far
        /// the motion's own sensitivity drives small differences apart
        shake: f64 = 0.0, Number(0.0..=1e3);
        /// Starts from which a model is judged beside its base alone, a linear map and the analytic solver, on one core of the CPU; 0: it
        /// is not judged
        verdict: usize = 32, Whole(0..=*STARTS.end());
        /// Recorded motion to compare a model with, in place of a solver: the TOML of a log, or its folder (`log.toml`). Of the log that it
        /// learned, the part that was held out
        data: Option<PathBuf> = None, Text;
        /// With --data: frames that a model sees before each start [default: as many as its predictions depend on]
        before: Option<usize> = None, Whole(0..=*FRAMES.end());
        /// With --data: frames between starts [default: those of a rollout]
        every: Option<usize> = None, Whole(FRAMES);
        /// With --data: another log (its TOML or folder) whose trajectories begin at frames of held-out ones and continue them by another
        /// simulator or by other steps. The model is judged from these starts, with that log beside it
        beside: Option<PathBuf> = None, Text;
        /// With --data: evaluations in which the analytic solver is calibrated; 0: it is judged only as the robot is described
        evaluations: usize = 300, Whole(0..=1_000_000);
    }
}

#[derive(Clone, Debug)]
pub struct Case {
    pub robot: String,
    pub solver: Choice,
    /// What it is compared with; none stands for what a model learned, else the robot's own.
    pub truth: Option<Truth>,
    pub asked: Protocol,
}

impl Case {
    /// The models that come with the project, by robot.
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
            // rapier as a truth costs a hundred times what ours does.
            asked.starts = if ModelConfig::truth_of(&folder)? == Truth::Rapier { asked.starts.div_ceil(4) } else { asked.starts };
            // A held arm does not move: Franka's model is for driven ones.
            asked.drive = if robot.starts_with("franka") { 1.0 } else { asked.drive };
            Ok(Self { robot, solver: Choice::Neural { folder, truth: None, device }, truth: None, asked })
        };
        models.into_iter().map(case).collect()
    }
}

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

impl Passive {
    /// Finds all that the cases, of one seed, name; a result called `name`.
    pub fn new(name: &str, cases: &[Case]) -> Result<Self> {
        let mut asked = Vec::new();
        for case in cases {
            let Protocol { starts, frames, seed, drive, before, every, beside, evaluations, .. } = case.asked.clone();
            let evaluated = evaluations != Protocol::default().evaluations;
            let idle = [
                ("--before", before.is_some()),
                ("--every", every.is_some()),
                ("--beside", beside.is_some()),
                ("--evaluations", evaluated),
            ];
            unused(&idle, "without --data")?;
            let system = System::named(&case.robot)?;
            let mut scenes: Vec<&str> = case.asked.scene.iter().map(String::as_str).collect();
            if scenes.is_empty() {
                scenes = system.usual_scenes();
            }
            let truth = case.truth.or(case.solver.learned()?).unwrap_or(system.spec.truth);
            let steps = frames.unwrap_or_else(|| nerd_train::evaluate::horizon(&system.name));
            let action = match drive {
                0.0 => Action::Zero,
                factor => Action::Random(factor),
            };
            let protocol = PassiveConfig { starts, steps, seed, action };
            let method = match case.asked.shake {
                0.0 => case.solver.title(&system)?,
                by => format!("{}, shaken by {by}", case.solver.title(&system)?),
            };
            let found = scenes.iter().map(|s| system.scene(s)).collect::<Result<Vec<_>, _>>()?;
            for scene in found {
                check(case, truth, &system, &scene, steps)?;
                asked.push(Asked { case: case.clone(), system: system.clone(), scene, truth, method: method.clone(), protocol });
            }
        }
        Ok(Self { name: name.into(), seed: cases.first().map_or(0, |case| case.asked.seed), asked })
    }

    pub fn rows(&self) -> Result<Rows> {
        let bar = progress::bar("rollout frames", self.asked.iter().map(|a| a.work() as u64).sum());
        let (mut done, mut rows) = (0, Vec::new());
        for asked in &self.asked {
            bar.say(&format!("{} in {}", asked.system.name, asked.scene.name));
            rows.push(asked.measure(&mut |step| bar.set((done + step * asked.protocol.starts) as u64))?);
            done += asked.work();
        }
        bar.finish();
        for (asked, row) in self.asked.iter().zip(&mut rows) {
            // The rows are worth keeping without it.
            row.verdict = asked.verdict().unwrap_or_else(|error| {
                nerd_train::tell!("{}: no verdict: {error:#}", asked.system.name);
                None
            });
        }
        Ok(Rows { rows })
    }
}

/// Refuses what says nothing, and what is more than can be borne.
fn check(case: &Case, truth: Truth, system: &System, scene: &Scene, steps: usize) -> Result<()> {
    let (itself, Protocol { starts, shake, .. }) = (case.solver.is(truth, system, scene), case.asked.clone());
    if itself && shake == 0.0 {
        bail!(
            "`{}` against itself is 0 everywhere; name what to measure: --solver neural or rapier, --preset, --substeps or --shake",
            truth.name()
        );
    }
    // Two batches with what their solvers keep, sums over steps, working memory of the truth.
    let bytes = case.solver.bytes()?.saturating_add(1024 * system.robot.state_dim());
    bounds::memory(&[("--starts", starts)], bytes)?;
    let substeps = case.solver.substeps().max(system.spec.substeps);
    Ok(bounds::time(&[("--starts", starts), ("--frames", steps), ("substeps", substeps)])?)
}

impl Asked {
    fn measure(&self, progress: &mut dyn FnMut(usize)) -> Result<Row> {
        let Self { case, system, scene, truth, method, protocol } = self;
        let mut solver = case.solver.build(system, protocol.starts)?;
        if case.asked.shake > 0.0 {
            solver = Box::new(Shaken::new(solver, case.asked.shake, protocol.seed));
        }
        let report = passive(system, scene, &mut *truth.solver(system), &mut *solver, *protocol, progress)?;
        let whose = |what: &str| format!("{method} on {} in {}: its {what}", system.name, scene.name);
        bounds::figures(&whose("error"), report.error.iter().chain(&report.standard_error).chain(&report.curve))?;
        bounds::figures(&whose("hold-last error"), &report.hold)?;
        let (robot, scene) = (system.name.clone(), scene.name.clone());
        // Only solvers' errors are compared, and the paper's errors are from the reference simulator.
        let paper = paper::passive_error(&robot, &scene).filter(|_| *truth == Truth::Paper);
        let model = if let Choice::Neural { folder, .. } = &case.solver { Some(shipped::from_root(folder)) } else { None };
        Ok(Row { robot, method: method.clone(), model, scene, truth: truth.name(), protocol: *protocol, report, paper, verdict: None })
    }

    /// What a model is worth, as it is and not shaken, beside the truth that it learned.
    fn verdict(&self) -> Result<Option<Verdict>> {
        let Self { case, system, scene, truth, protocol, .. } = self;
        let Choice::Neural { folder, .. } = &case.solver else { return Ok(None) };
        let model = Model::load(folder, system, None)?;
        if case.asked.verdict == 0 || case.asked.shake > 0.0 || model.config.truth != truth.name() {
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
        Measured::new(&rows, [Some(rows.table()), Some(rows.summary()), rows.verdicts()].into_iter().flatten().collect())
    }
}
