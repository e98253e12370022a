//! Speed against accuracy: every solver of a scene on one picture.
//!
//! x: microseconds a frame of one environment takes on one core. y: mean |difference| of q over the horizon from a
//! converged reference, passive motion from the robot's reset law. Time and error come from the same steps, so a broken
//! simulation cannot be fast. The reference's own error (its distance from half its substeps) is a dashed line, as are
//! the two floors that know no dynamics. A model that learned from another engine is held against that engine, as its name
//! says, since it cannot be nearer to the reference than what it learned. MuJoCo is asked in where somebody has it ([`Against`]).

mod figure;
mod front;
mod guest;
mod measure;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use crate::mujoco::Referee;
use nerd_model::folder::ModelConfig;
use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::Experiment;
use super::cost::on_one_core;
use crate::choice::{Choice, describe};
use crate::error::{Error, Result};
use crate::report::table::{digits, pair};
use crate::report::{Input, Inputs, Table};
use nerd_train::evaluate::{Action, PassiveConfig, summary};
use nerd_train::{bounds, shipped};

pub use guest::Against;

/// What to draw.
#[derive(Clone, Debug)]
pub struct ChartSettings {
    /// Robot, as [`System::named`] knows it.
    pub robot: String,
    /// Scene.
    pub scene: String,
    /// Model folders; none stands for those that come with the project.
    pub models: Vec<PathBuf>,
    /// Trajectories.
    pub starts: usize,
    /// Frames over which the error is the mean.
    pub horizon: usize,
    /// Largest number of substeps.
    pub substeps: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// Python that has MuJoCo, to draw that engine too.
    pub mujoco: Option<PathBuf>,
}

impl Default for ChartSettings {
    fn default() -> Self {
        let (robot, scene) = ("pendulum".into(), "free".into());
        Self { robot, scene, models: Vec::new(), starts: 64, horizon: 100, substeps: 256, seed: 500, mujoco: None }
    }
}

/// A chart to be measured.
pub struct Chart {
    settings: ChartSettings,
    system: Arc<System>,
    scene: Arc<Scene>,
    methods: Vec<Method>,
    protocol: PassiveConfig,
    referee: Option<Mutex<Referee>>,
}

/// One of its solvers.
struct Method {
    setting: Setting,
    /// Name in the legend.
    series: String,
    /// What it is held against, if that is not the chart's reference.
    own: Option<Truth>,
}

/// What a chart shows, and what that was held against.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChartData {
    /// Robot.
    pub robot: String,
    /// Scene.
    pub scene: String,
    /// Trajectories and frames.
    pub protocol: PassiveConfig,
    /// The reference, in words.
    pub reference: String,
    /// Its distance from half its substeps.
    pub reference_error: f64,
    /// Error of the predictor that repeats the start.
    pub hold: f64,
    /// Error of the one that keeps the start's velocity.
    pub glide: f64,
    /// The marks.
    pub points: Vec<Point>,
    /// What MuJoCo was held against, if it was asked in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mujoco: Option<Against>,
}

/// One mark on the chart.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// Name in the legend.
    pub series: String,
    /// The solver, for [`nerd_model::pick`]; none of another engine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setting: Option<Setting>,
    /// Substeps a frame.
    pub substeps: Option<usize>,
    /// Frame of one environment on one core: the fastest of a few runs.
    pub microseconds: f64,
    /// Mean over coordinates.
    pub error: f64,
    /// Mean |difference| of each.
    pub by_coordinate: Vec<f64>,
    /// Rollouts that left.
    pub diverged: usize,
    /// Whether no other point beats it in both.
    pub front: bool,
    /// Whether its error is against a reference of its own, so that it competes with no other series.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub own: bool,
}

impl Chart {
    /// Finds all that the settings name.
    ///
    /// # Errors
    /// If the robot, the scene, a model or MuJoCo is not there, or more is asked for than can be borne.
    pub fn new(settings: ChartSettings) -> Result<Self> {
        let ChartSettings { starts, horizon, substeps, seed, .. } = settings;
        let system = System::named(&settings.robot)?;
        let scene = system.scene(&settings.scene)?;
        let frames = [("--starts", starts), ("--frames", horizon)];
        // Every state of the reference is kept, and of a model's own truth.
        bounds::memory(&frames, 16 * system.robot.state_dim())?;
        // The reference has four times the substeps.
        bounds::time(&[frames[0], frames[1], ("4 x --substeps", 4 * substeps)])?;
        let mut models = settings.models.clone();
        if models.is_empty() {
            models = shipped::folders(&shipped::models(), &system.name)?;
            // Of this robot, not of one whose name begins alike.
            models.retain(|folder| ModelConfig::read(folder).is_ok_and(|model| model.robot == system.name));
        }
        let truth = system.spec.truth;
        let methods = methods(!scene.colliders.is_empty(), only_implicit(&system), substeps).into_iter().chain([truth.into()]);
        let methods = methods.chain(models.into_iter().map(Setting::Neural)).map(|setting| Method::new(setting, truth));
        let methods = methods.collect::<Result<_>>()?;
        let protocol = PassiveConfig { starts, steps: horizon, seed, action: Action::Limp };
        // Begun first, for it may not be there.
        let referee = settings.mujoco.as_ref().map(|python| guest::referee(python, &system, &scene, protocol)).transpose()?;
        Ok(Self { settings, system, scene, methods, protocol, referee: referee.map(Mutex::new) })
    }

    fn contact(&self) -> bool {
        !self.scene.colliders.is_empty()
    }
}

/// Whether a robot is stepped by the implicit step, whatever is asked for.
fn only_implicit(system: &System) -> bool {
    system.robot.sprung() || system.robot.dry()
}

/// Analytic solvers at powers of two of substeps.
fn methods(contact: bool, implicit: bool, most: usize) -> Vec<Setting> {
    let powers = |last: usize| std::iter::successors(Some(1), |n| Some(2 * n)).take_while(move |n| *n <= last);
    let mut methods: Vec<Setting> = if implicit { Vec::new() } else { powers(most).map(Setting::Euler).collect() };
    if contact || implicit {
        methods.extend(powers(most / 2).map(Setting::Implicit));
    }
    if contact {
        methods.extend(powers(most / 4).map(Setting::RapierSteps));
    } else if !implicit {
        methods.extend(powers(most.min(32)).map(Setting::Rk4));
    }
    methods.extend(powers(most).map(Setting::Rapier));
    methods
}

impl Method {
    /// One of a robot of this truth.
    fn new(setting: Setting, truth: Truth) -> Result<Self> {
        let Setting::Neural(folder) = &setting else {
            let whose = if setting == truth.into() { " (NeRD's truth)" } else { "" };
            return Ok(Self { series: format!("{}{whose}", setting.series()), own: None, setting });
        };
        let name = describe(&ModelConfig::read(folder)?);
        let own = Some(ModelConfig::truth_of(folder)?).filter(|own| *own != truth);
        let series = own.map_or(name.clone(), |own| format!("{name}, against {}", own.name()));
        Ok(Self { series, own, setting })
    }
}

impl Experiment for Chart {
    type Data = ChartData;

    fn name(&self) -> String {
        format!("chart-{}-{}", self.system.name, self.scene.name)
    }

    fn seed(&self) -> u64 {
        self.settings.seed
    }

    fn effort(&self) -> f64 {
        let guests = if self.referee.is_some() { guest::marks(self.contact(), self.settings.substeps) } else { 0 };
        (self.methods.len() + guests) as f64 * (self.settings.starts * self.settings.horizon) as f64
    }

    /// Of each solver one setting: whatever changes the others changes it.
    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs(vec![Input::robot(&self.system)]);
        for (k, method) in self.methods.iter().enumerate() {
            let next = self.methods.get(k + 1).is_some_and(|next| next.series == method.series);
            if method.setting.substeps().is_none_or(|n| n == 4 || (n < 4 && !next)) {
                inputs.solver(&Choice::Setting(method.setting.clone()), &self.settings.robot, &self.scene.name)?;
            }
            if let Some(own) = method.own {
                inputs.add(Input::motion(&self.settings.robot, &self.scene.name, &own.into())?);
            }
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<ChartData> {
        let (mut data, reference) = on_one_core(|| measure::all(self))?;
        if let Some(referee) = &self.referee {
            let mut referee = referee.lock().map_err(|_| Error::msg("MuJoCo is gone"))?;
            let (points, against) = guest::points(&mut referee, self, &reference, &data.reference)?;
            data.points.extend(points);
            data.mujoco = Some(against);
        }
        front::mark(&mut data.points);
        Ok(data)
    }

    fn tables(&self, data: &ChartData) -> Result<Vec<Table>> {
        let rows = data.points.iter().map(|p| {
            vec![
                p.series.clone(),
                p.substeps.map_or_else(|| "-".into(), |n| n.to_string()),
                digits(p.microseconds),
                pair(&summary(&self.system, &p.by_coordinate)),
                p.diverged.to_string(),
                if p.front { "*" } else { "" }.into(),
            ]
        });
        let header = ["solver", "substeps", "us a frame", "error (rad or m)", "diverged", "front"];
        let mut note =
            format!("{} {}, mean |dq| over {} frames, reference: {}", data.robot, data.scene, data.protocol.steps, data.reference);
        if let Some(Against { version, reference, reference_error }) = &data.mujoco {
            let error = reference_error.map_or_else(String::new, |e| format!(", whose own error is {}", digits(e)));
            note += &format!(". MuJoCo {version} is held against {reference}{error}");
        }
        Ok(vec![Table::new(&self.name(), &header).with(rows).noted(&(note + "."))])
    }

    fn pictures(&self, data: &ChartData, stem: &Path) -> Result<()> {
        figure::figure(data).save(stem)
    }
}
