//! Measures errors of contact points along unseen motions in new scenes, and the time of a frame.
//!
//! Starts, scenes and torques are drawn as for a dataset ([`nerd_sim::dataset::record`]), from another seed. The
//! reference is the implicit step with four times the finest solver's substeps. An error is the mean distance (m) of
//! contact points (a cable's nodes) from the reference. Time and error come from the same frames.

mod rollout;
mod shown;

use nerd_sim::dataset::GenerateConfig;
use nerd_sim::instruments::{Glide, Hold};
use nerd_sim::rig::rigged;
use rollout::{Points, Rollout, distances, points};

use crate::prelude::*;
use nerd_cli::describe::title;
use nerd_train::cost::{on_one_core, powers};
use nerd_train::unroll;

settings! {
    /// Settings: errors along motions that no solver has seen.
    pub struct Motions {
        /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable
        /// .toml
        robot: String = "nerd-sim/assets/cables/lead-pegs.toml".into(), Text;
        /// Folders of models, comma-separated [default: none]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Number of motions
        trajectories: usize = 32, Whole(STARTS);
        /// Frames of a motion
        frames: usize = 300, Whole(FRAMES);
        /// Largest number of substeps per frame
        max_substeps: usize = 16, Whole(1..=256);
        /// Seed of the motions
        seed: u64 = 500, Whole(SEEDS);
    }
}

#[derive(Serialize)]
pub struct MotionErrors {
    pub robot: String,
    pub reference: String,
    pub rows: Vec<Row>,
}

#[derive(Serialize)]
pub struct Row {
    pub series: String,
    pub substeps: Option<usize>,
    /// Wall time of a frame of one environment on one core (us); `None` for a predictor without dynamics.
    pub microseconds: Option<f64>,
    /// Mean distance from the reference (m) by frame, over motions that are not lost; empty if all are lost.
    pub curve: Vec<f64>,
    /// Mean distance from the reference (m) of each motion that is not lost.
    pub motions: Vec<f64>,
    /// Number of motions that the solver gave up, or that went too far; the row's other figures leave them out.
    pub lost: usize,
}

impl Motions {
    fn name(&self) -> String {
        format!("motions-{}", Path::new(&self.robot).file_stem().unwrap_or_default().to_string_lossy())
    }

    /// Lists the solvers to compare with the reference; two predictors without dynamics come on top.
    fn settings(&self) -> Vec<SolverSpec> {
        powers(self.max_substeps)
            .map(SolverSpec::implicit)
            .chain(self.model.iter().cloned().map(SolverSpec::neural))
            .collect()
    }

    pub fn errors(&self) -> Result<MotionErrors> {
        let system = System::named(&self.robot)?;
        if system.robot.contact_points.is_empty() {
            bail!(
                "--robot {}: it has no contact point whose place could be measured; give it [[contact]] points",
                self.robot
            );
        }
        let settings = self.settings();
        let finest = 4 * self.max_substeps;
        let frames = [("--trajectories", self.trajectories), ("--frames", self.frames)];
        bounds::memory(&frames, 64 * system.robot.state_dim())?;
        bounds::time(&[frames[0], frames[1], ("4 x --max-substeps", finest)])?;
        // Builds all solvers first: a model of another robot is refused before the reference is rolled out.
        let solvers =
            settings.iter().map(|setting| setting.solver(&system, self.trajectories)).collect::<Result<Vec<_>, _>>()?;
        let bar = bar("solvers", settings.len() as u64 + 1);
        bar.say(&format!("reference, x{finest}"));
        // Records each motion in its own batch, in parallel: one batch of few motions would use few cores.
        let config = GenerateConfig {
            transitions: self.trajectories * self.frames,
            frames: self.frames,
            seed: self.seed,
            shard_trajectories: 1,
            ..GenerateConfig::default()
        };
        let reference = ArticulatedConfig::implicit(finest, Friction::Coulomb);
        let reference = || rigged(Box::new(Articulated::new(reference)), &system);
        let recorded = unroll::motions(&system, &reference, &config, &|_| ())?;
        let truth: Points = (1..=self.frames).map(|frame| points(&system, &recorded.states_at(frame))).collect();
        let rows = on_one_core(|| {
            let mut rows = Vec::new();
            for (setting, solver) in settings.iter().zip(solvers) {
                bar.add(1);
                let series = if setting.is_neural() { title(setting)? } else { setting.series().to_string() };
                rows.push(Row::new(&series, Some(setting), rollout::along(&recorded, &system, solver)?, &truth)?);
            }
            let floors: [(&str, Box<dyn Solver>); 2] =
                [("hold last", Box::new(Hold)), ("constant velocity", Box::new(Glide))];
            for (name, floor) in floors {
                rows.push(Row::new(name, None, rollout::along(&recorded, &system, floor)?, &truth)?);
            }
            Ok::<_, Error>(rows)
        })?;
        bar.finish();
        Ok(MotionErrors {
            robot: system.name.clone(),
            reference: format!("articulated, implicit, {finest} substeps"),
            rows,
        })
    }
}

impl Row {
    /// Computes the errors of a rollout; `setting` is `None` for a predictor without dynamics.
    fn new(series: &str, setting: Option<&SolverSpec>, rollout: Rollout, truth: &Points) -> Result<Self> {
        let (curve, motions) = distances(&rollout.points, truth, &rollout.failed, setting.is_some());
        bounds::figures(&format!("{series}: its mean error"), &motions)?;
        let lost = rollout.failed.len() - motions.len();
        let substeps = setting.and_then(SolverSpec::asked);
        Ok(Self {
            series: series.into(),
            substeps,
            microseconds: setting.map(|_| rollout.microseconds),
            curve,
            motions,
            lost,
        })
    }
}

impl Experiment for Motions {
    fn about(&self) -> Result<About> {
        let system = System::named(&self.robot)?;
        let scene = system.spec.data_scene.clone().unwrap_or_else(|| "free".into());
        let mut inputs =
            Inputs(vec![Input::robot(&system), Input::motion(&self.robot, &scene, &SolverSpec::implicit(4))?]);
        inputs.models(&self.model)?;
        let effort = ((self.settings().len() + 2) * self.trajectories * self.frames) as f64;
        Ok(About { name: self.name(), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let data = self.errors()?;
        Ok(Measured::new(&data, vec![self.table(&data)])?.with("figure", self.figure(&data)))
    }
}
