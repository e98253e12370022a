//! What a frame costs as a robot grows, and from which size on a learned solver would be the cheaper one.
//!
//! Arms of n links of 0.1 m, hinged in turn about y and z and held 0.2 m above the ground, on which the rest of them falls; a
//! contact point at every link's end. Analytic solvers are timed and held against a converged reference from random
//! starts; of each size the cheapest setting within a tolerance is drawn. Learned solvers are only timed (nobody has trained
//! them: their weights are zero, and a frame costs the same whatever the weights): the crossing holds if one of that size
//! learns to that tolerance.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::pick::Setting;
use nerd_model::transformer::{Positions, TransformerConfig, Weights};
use nerd_sim::instruments::{Hold, Recorder};
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use super::Experiment;
use super::cost::{Repeat, each, on_one_core, timed};
use crate::error::{Result, refuse};
use crate::report::plot::{Figure, Series};
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};
use nerd_train::evaluate::{Action, PassiveConfig, passive};
use nerd_train::stats::mean;
use nerd_train::{bounds, progress};

/// Substeps of the reference.
const FINEST: usize = 256;
/// Networks: width, layers, what they predict on top of.
const NETWORKS: [(usize, usize, Base); 4] = [(64, 2, Base::State), (64, 2, Base::Flight), (192, 6, Base::State), (192, 6, Base::Flight)];

/// What to grow.
#[derive(Clone, Debug)]
pub struct Grow {
    /// Numbers of links, each once.
    pub links: Vec<usize>,
    /// Trajectories.
    pub starts: usize,
    /// Frames.
    pub horizon: usize,
    /// Errors (mean |dq|, rad) that an analytic solver is asked for.
    pub tolerances: Vec<f64>,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for Grow {
    fn default() -> Self {
        Self { links: vec![4, 8, 16, 32, 64], starts: 16, horizon: 30, tolerances: vec![0.03, 0.01], seed: 500 }
    }
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Grown {
    /// Frames.
    pub horizon: usize,
    /// Trajectories.
    pub starts: usize,
    /// Every solver on every arm.
    pub points: Vec<Point>,
}

/// One solver on one arm.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// Links of the arm.
    pub links: usize,
    /// In words.
    pub solver: String,
    /// Of an analytic solver.
    pub setting: Option<Setting>,
    /// Frame of one environment on one core.
    pub microseconds: f64,
    /// Mean |dq| from the reference; none of what is not trained.
    pub error: Option<f64>,
}

impl Grow {
    fn check(&self) -> Result<()> {
        let longest = self.links.iter().copied().max().unwrap_or(0);
        let frames = [("--starts", self.starts), ("--frames", self.horizon), ("--links", longest)];
        bounds::memory(&frames, 16)?;
        bounds::time(&[frames[0], frames[1], frames[2], ("substeps", FINEST)])?;
        if (1..self.links.len()).any(|k| self.links[..k].contains(&self.links[k])) {
            refuse!("--links: each number once");
        }
        Ok(())
    }

    /// Every solver on an arm of that many links.
    fn arm(&self, links: usize) -> Result<Vec<Point>> {
        let system = arm(links)?;
        let scene = system.scene("ground")?;
        let config = PassiveConfig { starts: self.starts, steps: self.horizon, seed: self.seed, action: Action::Limp };
        let mut truth = Recorder::new(Setting::Implicit(FINEST).solver(&system)?);
        passive(&system, &scene, &mut truth, &mut Hold, config, &mut |_| ())?;
        let mut points = Vec::new();
        let settings = [1, 2, 4, 8, 16].map(Setting::Implicit).into_iter().chain([4, 8, 16, 32, 64, 128].map(Setting::Euler));
        for setting in settings.chain([Setting::RapierSteps(4)]) {
            // What leaves has no error to speak of.
            let Ok((report, microseconds)) = timed((&system, &scene), setting.solver(&system)?, &truth.frames, config) else { continue };
            let error = mean(&report.error);
            bounds::figures(&format!("{setting} on {links} links: its mean error"), &[error])?;
            points.push(Point { links, solver: setting.to_string(), setting: Some(setting), microseconds, error: Some(error) });
        }
        for (embedding, layers, base) in NETWORKS {
            let solver = format!("NeRD {}, E {embedding}, {layers} layers", if base.flies() { "on flight" } else { "paper's form" });
            let microseconds = untrained(&system, &scene, embedding, layers, base)?;
            points.push(Point { links, solver, setting: None, microseconds, error: None });
        }
        Ok(points)
    }

    /// Cheapest analytic settings within each tolerance, and the learned solvers.
    fn series(&self, points: &[Point]) -> Vec<Series> {
        let cheapest = |tolerance: &f64| {
            let of = |links: &usize| {
                let enough = points.iter().filter(|p| p.links == *links && p.error.is_some_and(|e| e <= *tolerance));
                let best = enough.min_by(|a, b| a.microseconds.total_cmp(&b.microseconds))?;
                let word = best.solver.strip_prefix("articulated ").unwrap_or(&best.solver);
                Some((*links as f64, best.microseconds, word.to_string()))
            };
            Series { name: format!("cheapest analytic within {tolerance} rad"), points: self.links.iter().filter_map(of).collect() }
        };
        let mut learned: Vec<Series> = Vec::new();
        for p in points.iter().filter(|p| p.setting.is_none()) {
            let mark = (p.links as f64, p.microseconds, String::new());
            match learned.iter_mut().find(|s| s.name == p.solver) {
                Some(s) => s.points.push(mark),
                None => learned.push(Series { name: p.solver.clone(), points: vec![mark] }),
            }
        }
        self.tolerances.iter().map(cheapest).chain(learned).collect()
    }
}

impl Experiment for Grow {
    type Data = Grown;

    fn name(&self) -> String {
        "grow".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.links.len() * self.starts * self.horizon) as f64
    }

    /// The arms are made here; how solvers step is known by a robot that touches the ground, too.
    fn inputs(&self) -> Result<Inputs> {
        self.check()?;
        let mut inputs = Inputs::default();
        for links in &self.links {
            inputs.add(Input::Data { name: format!("arm of {links} links"), sha256: arm(*links)?.sha256() });
        }
        for setting in [Setting::Implicit(4), Setting::Euler(16), Setting::RapierSteps(4)] {
            inputs.add(Input::motion("ant", "ground", &setting)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Grown> {
        let bar = progress::bar("sizes", self.links.len() as u64);
        let mut points = Vec::new();
        for (k, links) in self.links.iter().enumerate() {
            points.extend(on_one_core(|| self.arm(*links))?);
            bar.set(k as u64 + 1);
        }
        bar.finish();
        Ok(Grown { horizon: self.horizon, starts: self.starts, points })
    }

    fn tables(&self, data: &Grown) -> Result<Vec<Table>> {
        let series = self.series(&data.points);
        let names: Vec<&str> = std::iter::once("links").chain(series.iter().map(|s| s.name.as_str())).collect();
        let of = |s: &Series, links: usize| {
            let found = s.points.iter().find(|p| p.0 == links as f64);
            found.map_or_else(|| "-".into(), |p| if p.2.is_empty() { digits(p.1) } else { format!("{} ({})", digits(p.1), p.2) })
        };
        let row = |links: &usize| std::iter::once(links.to_string()).chain(series.iter().map(|s| of(s, *links))).collect();
        let note = "Microseconds a frame of one environment on one core; x4: four substeps.";
        Ok(vec![Table::new("grow", &names).with(self.links.iter().map(row)).noted(note)])
    }

    fn pictures(&self, data: &Grown, stem: &Path) -> Result<()> {
        let figure = Figure {
            title: "An arm on the ground, growing (x4: four substeps a frame)".into(),
            x: "links".into(),
            y: "microseconds a frame, one environment, one core".into(),
            series: self.series(&data.points),
            front: Vec::new(),
            levels: Vec::new(),
        };
        figure.save(stem)
    }
}

/// Microseconds of a frame of a learned solver on 64 environments whose past is full.
fn untrained(system: &Arc<System>, scene: &Arc<Scene>, embedding: usize, layers: usize, base: Base) -> Result<f64> {
    let (inputs, outputs) = (Features::inputs(system, base), Features::outputs(system));
    let positions = Positions::Rotary;
    let network = TransformerConfig { layers, heads: embedding / 16, positions, ..TransformerConfig::paper(inputs, outputs, embedding) };
    let unit = |n: usize| Moments { mean: vec![0.0; n], variance: vec![1.0; n], epsilon: 1e-5 };
    let config = ModelConfig {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        model_sha256: String::new(),
        truth: "none".into(),
        base,
        view: Default::default(),
        network,
        data_sha256: String::new(),
        transitions: 0,
        updates: 0,
        batch: 0,
        provenance: Default::default(),
    };
    let weights = Weights { config: network, flat: vec![0.0; network.parameters()] };
    let model = Model { config, normalizer: Normalizer { inputs: unit(inputs), outputs: unit(outputs) }, weights };
    let (envs, frames) = (64, 20);
    let batch = Batch::new(system, scene, envs);
    let torques = vec![0.0; envs * system.robot.joint_count()];
    let mut simulation = Simulation::new(batch, Neural::on_cpu(model, system));
    let state = system.default_state();
    (0..envs).for_each(|env| simulation.reset(env, &state));
    (0..10).try_for_each(|_| simulation.step(&torques))?;
    let best = Repeat::times(3).best(|| -> Result<_> {
        let started = Instant::now();
        (0..frames).try_for_each(|_| simulation.step(&torques))?;
        Ok(started.elapsed())
    })?;
    Ok(each(best, envs * frames))
}

/// An arm of `links` links of 0.1 m and 0.2 kg.
fn arm(links: usize) -> Result<Arc<System>> {
    let mut urdf = String::from(r#"<robot name="arm"><link name="l0"/>"#);
    let mut toml = String::from(
        "urdf = \"\"\nfloating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, -9.81]\nsubsteps = 16\n\
         material = { stiffness = 1e4, damping = 1e2, friction_damping = 1e2, friction = 0.5 }\n",
    );
    let (mut joints, mut contacts) = (String::new(), String::new());
    // So nearly straight that no tip starts in the ground.
    let (a, b) = (0.5 / links as f64, 4.0 / links as f64);
    for n in 1..=links {
        let (z, x) = if n == 1 { (0.2, 0.0) } else { (0.0, 0.1) };
        let axis = if n % 2 == 1 { "0 1 0" } else { "0 0 1" };
        urdf += &format!(
            r#"<link name="l{n}"><inertial><origin xyz="0.05 0 0"/><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link><joint name="j{n}" type="continuous"><parent link="l{}"/><child link="l{n}"/><origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/><dynamics damping="0.05"/></joint>"#,
            n - 1,
        );
        joints += &format!(
            "[[joint]]\nname = \"j{n}\"\narmature = 0.01\nsample = {{ q = \"U(-{a}, {a})\", qd = \"U(-{b}, {b})\" }}\nreset = {{ q = \"U(-{a}, {a})\", qd = \"U(-{b}, {b})\" }}\n"
        );
        contacts += &format!("[[contact]]\nlink = \"l{n}\"\npoint = [0.1, 0.0, 0.0]\nradius = 0.02\nthickness = 0.02\n");
    }
    toml += &(joints + &contacts + "[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n");
    Ok(Arc::new(System::from_text("arm", &(urdf + "</robot>"), Some(&toml))?))
}
