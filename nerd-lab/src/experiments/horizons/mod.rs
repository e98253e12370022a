//! How the error of models grows over 1000 frames, as percentiles over rollouts, beside the floor that repeats the start; and one
//! rollout of each over the truth's.

mod figure;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_core::state::wrap;
use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::Experiment;
use crate::choice::describe;
use crate::error::Result;
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};
use nerd_train::device::Device;
use nerd_train::evaluate::{Action, PassiveConfig, differences, summary, summary_names, watched};
use nerd_train::stats::percentile;
use nerd_train::{bounds, progress, shipped};

/// Frames in the table.
const SHOWN: [usize; 3] = [10, 100, 1000];

/// What to roll out.
#[derive(Clone, Debug)]
pub struct Horizons {
    /// Folders of models.
    pub models: Vec<PathBuf>,
    /// Rollouts of each.
    pub starts: usize,
    /// Frames.
    pub steps: usize,
    /// Seed of the starts.
    pub seed: u64,
    /// Where networks are computed.
    pub device: Device,
}

impl Default for Horizons {
    fn default() -> Self {
        let models = ["cartpole", "pendulum", "cube", "ant", "anymal"].map(|robot| shipped::model(Truth::Articulated, robot));
        Self { models: models.into(), starts: 128, steps: 1000, seed: 500, device: Device::Cpu }
    }
}

/// All models' errors by frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HorizonRows {
    /// A model each.
    pub rows: Vec<Horizon>,
}

/// One model's errors by frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Horizon {
    /// Robot.
    pub robot: String,
    /// Form and size of the network.
    pub method: String,
    /// Folder.
    pub model: String,
    /// What it learned, and is held against.
    pub truth: String,
    /// Scene.
    pub scene: String,
    /// Rollouts.
    pub starts: usize,
    /// Those that left.
    pub diverged: usize,
    /// Frames that the bands are given at.
    pub frames: Vec<usize>,
    /// Position (m), orientation (rad), joints (rad or m); the mean of the joints if there are more than two.
    pub quantities: Vec<Quantity>,
    /// Coordinates of the first start, for the picture alone.
    #[serde(skip)]
    paths: Vec<Trace>,
    #[serde(skip)]
    frame_time: f64,
}

/// Errors of one quantity.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Quantity {
    /// Its name, with its unit.
    pub name: String,
    /// 10th, 50th and 90th percentile over rollouts, by frame.
    pub bands: Vec<[f64; 3]>,
    /// Median of the predictor that repeats the start.
    pub hold: Vec<f64>,
}

/// A coordinate in the truth and in the prediction.
#[derive(Clone, Debug, Default)]
struct Trace {
    name: String,
    /// Place in a state, and whether it wraps.
    at: usize,
    wraps: bool,
    /// Truth and prediction by frame.
    both: [Vec<f64>; 2],
}

/// A model, and where it is rolled out.
struct Asked {
    config: ModelConfig,
    system: Arc<System>,
    scene: Arc<Scene>,
    truth: Truth,
}

impl Asked {
    /// On the robot's first scene with something to touch, if the model knows flight: that has no error where there is nothing.
    fn new(folder: &Path) -> Result<Self> {
        let config = ModelConfig::read(folder)?;
        let system = System::named(&config.robot)?;
        let scenes = system.usual_scenes();
        let name = scenes.iter().find(|s| !config.base.flies() || **s != "free").copied().unwrap_or("free");
        let (scene, truth) = (system.scene(name)?, ModelConfig::truth_of(folder)?);
        Ok(Self { config, scene, truth, system })
    }
}

impl Horizons {
    fn rollouts(&self, folder: &Path) -> Result<Horizon> {
        let Asked { config, system, scene, truth } = Asked::new(folder)?;
        let mut learned = self.device.neural(folder, &system, None, self.starts)?;
        let protocol = PassiveConfig { starts: self.starts, steps: self.steps, seed: self.seed, action: Action::Zero };
        let bar = progress::bar(&format!("frames of {}", folder.display()), self.steps as u64);
        let starts: Vec<_> = (0..self.starts as u64).map(|env| start(&system, Start::Reset, &mut stream(self.seed, env))).collect();
        let (mut errors, mut holds, mut paths) = (Vec::new(), Vec::new(), paths(&system));
        let report = watched(&system, &scene, [&mut *truth.solver(&system), &mut learned], protocol, &mut |step, real, learned| {
            bar.set(step as u64);
            let row = |env: usize, other: &[f64]| summary(&system, &differences(&system, real.state(env), other));
            errors.push((0..self.starts).map(|env| row(env, learned.state(env))).collect::<Vec<_>>());
            holds.push(starts.iter().enumerate().map(|(env, start)| row(env, start)).collect::<Vec<_>>());
            for path in &mut paths {
                path.both.iter_mut().zip([real, learned]).for_each(|(both, batch)| both.push(batch.state(0)[path.at]));
            }
        })?;
        bar.finish();
        bounds::figures(&format!("{}: error", folder.display()), &report.error)?;
        paths.iter_mut().filter(|p| p.wraps).for_each(|p| p.both.iter_mut().for_each(|path| unwrap(path)));
        let frames = frames(self.steps);
        let at = |rows: &[Vec<Vec<f64>>], frame: usize, k: usize, share: f64| {
            percentile(rows[frame - 1].iter().map(|row| row[k]).collect(), share)
        };
        let quantities = summary_names(&system).into_iter().enumerate().map(|(k, name)| Quantity {
            name,
            bands: frames.iter().map(|f| [0.1, 0.5, 0.9].map(|share| at(&errors, *f, k, share))).collect(),
            hold: frames.iter().map(|f| at(&holds, *f, k, 0.5)).collect(),
        });
        Ok(Horizon {
            method: describe(&config),
            model: shipped::from_root(folder),
            truth: truth.name(),
            scene: scene.name.clone(),
            starts: self.starts,
            diverged: report.diverged,
            quantities: quantities.collect(),
            frames,
            paths,
            frame_time: system.frame_time,
            robot: config.robot,
        })
    }
}

impl Experiment for Horizons {
    type Data = HorizonRows;

    fn name(&self) -> String {
        "horizons".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.models.len() * self.starts) as f64 * self.steps as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for folder in &self.models {
            let Asked { system, scene, truth, .. } = Asked::new(folder)?;
            // Of every frame the errors of every start are kept, and the floor's.
            let frames = [("--starts", self.starts), ("--frames", self.steps)];
            bounds::memory(&frames, 64 + 16 * (2 + system.robot.joint_count()))?;
            bounds::time(&[frames[0], frames[1], ("substeps", system.spec.substeps)])?;
            inputs.add(Input::robot(&system));
            inputs.add(Input::model(folder)?);
            inputs.add(Input::motion(&system.name, &scene.name, &truth.into())?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<HorizonRows> {
        Ok(HorizonRows { rows: self.models.iter().map(|folder| self.rollouts(folder)).collect::<Result<_>>()? })
    }

    fn tables(&self, data: &HorizonRows) -> Result<Vec<Table>> {
        let rows = data.rows.iter().flat_map(|h| h.quantities.iter().map(|q| h.cells(q)));
        let shown = SHOWN.map(|f| format!("{f} frames"));
        let header = ["robot", "scene", "error", &shown[0], &shown[1], &shown[2], "hold last, at the end", "diverged"];
        let note = "Passive motion, median error [10th to 90th percentile] after so many frames.";
        Ok(vec![Table::new("horizons", &header).with(rows).noted(note)])
    }

    /// One each, `horizon-MODEL`.
    fn pictures(&self, data: &HorizonRows, stem: &Path) -> Result<()> {
        for horizon in &data.rows {
            let name = Path::new(&horizon.model).file_name().map_or_else(|| horizon.robot.clone().into(), |n| n.to_string_lossy());
            figure::draw(horizon, &stem.with_file_name(format!("horizon-{name}")))?;
        }
        Ok(())
    }
}

impl Horizon {
    /// A row of the table.
    fn cells(&self, q: &Quantity) -> Vec<String> {
        let cell = |frame: usize| {
            let Some(k) = self.frames.iter().position(|f| *f == frame) else { return "-".into() };
            let [low, middle, high] = q.bands[k].map(digits);
            format!("{middle} [{low} to {high}]")
        };
        let hold = q.hold.last().map_or_else(String::new, |h| digits(*h));
        let start = [self.robot.clone(), self.scene.clone(), q.name.clone()];
        start.into_iter().chain(SHOWN.map(cell)).chain([hold, format!("{} of {}", self.diverged, self.starts)]).collect()
    }
}

/// Frames to be shown of so many: evenly over their logarithm, and those of the table.
fn frames(last: usize) -> Vec<usize> {
    let even = (0..=60).map(|k| (last as f64).powf(f64::from(k) / 60.0).round() as usize);
    even.chain(SHOWN).filter(|f| *f <= last).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Coordinates worth drawing: height, and the first joints.
fn paths(system: &System) -> Vec<Trace> {
    let (robot, gravity) = (&system.robot, system.gravity());
    let up = (0..3).max_by(|a, b| gravity[*a].abs().total_cmp(&gravity[*b].abs())).unwrap_or(2);
    let height = robot.floating().then(|| Trace { name: "height of the root (m)".into(), at: up, ..Trace::default() });
    let named = |name: &str| format!("{name} (rad or m)");
    let joint = |(k, j): (usize, &nerd_core::robot::Joint)| Trace {
        name: named(&j.name),
        at: robot.root_coords() + k,
        wraps: j.wraps(),
        ..Trace::default()
    };
    height.into_iter().chain(robot.joints().enumerate().map(joint)).take(3).collect()
}

/// Takes the jumps out of an angle.
fn unwrap(path: &mut [f64]) {
    for k in 1..path.len() {
        path[k] = path[k - 1] + wrap(path[k] - path[k - 1]);
    }
}
