//! Along motions that no solver has seen, in scenes laid out anew: how far a robot's contact points are from where they should be, and what a
//! frame costs.
//!
//! Starts, scenes and torques are drawn as those of a data set ([`nerd_sim::dataset::begin`]), from a seed of their own. The reference is
//! the implicit step with four times as many substeps as the finest solver here. An error is the distance (m) of contact points, a
//! cable's nodes say, averaged over them. Time and error come from the same frames.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_model::folder::ModelConfig;
use nerd_model::pick::Setting;
use nerd_sim::dataset::{GenerateConfig, begin, record};
use nerd_sim::instruments::{Glide, Hold, Timed};
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use super::Experiment;
use super::cost::{each, on_one_core};
use crate::bounds::{self, FRAMES, SEEDS, STARTS};
use crate::choice::{Choice, describe};
use crate::error::{Result, refuse};
use crate::progress;
use crate::report::plot::{Figure, Series};
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};
use crate::settings::settings;
use crate::stats::{mean, percentile};

settings! {
    /// Along motions that no solver has seen.
    pub struct Motions {
        /// Robot: a name, or the path of a .urdf or .toml
        robot: String = "nerd-sim/assets/cables/lead-pegs.toml".into(), Text;
        /// Folders of models, comma-separated [default: none]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Motions
        starts: usize = 32, Whole(STARTS);
        /// Frames of each
        frames: usize = 300, Whole(FRAMES);
        /// Largest number of substeps
        substeps: usize = 16, Whole(1..=256);
        /// Seed of the motions
        seed: u64 = 500, Whole(SEEDS);
    }
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Moved {
    /// Robot.
    pub robot: String,
    /// The reference, in words.
    pub reference: String,
    /// A solver each.
    pub rows: Vec<Row>,
}

/// One solver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Name in the legend.
    pub series: String,
    /// Substeps a frame, of an analytic one.
    pub substeps: Option<usize>,
    /// Frame of one environment on one core; none of what knows no dynamics.
    pub microseconds: Option<f64>,
    /// Mean distance (m) by frame.
    pub curve: Vec<f64>,
    /// Mean distance (m) of each motion.
    pub motions: Vec<f64>,
    /// Motions that left or could not be gone on with.
    pub lost: usize,
}

/// Places of contact points by frame and motion.
type Places = Vec<Vec<Vec<Vector3<f64>>>>;

/// What is held against the reference.
enum Entry {
    Solver(Box<Setting>),
    Hold,
    Glide,
}

impl Motions {
    fn config(&self) -> GenerateConfig {
        GenerateConfig { transitions: self.starts * self.frames, frames: self.frames, seed: self.seed, ..GenerateConfig::default() }
    }

    fn entries(&self) -> Vec<Entry> {
        let powers = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n <= self.substeps);
        let models = self.model.iter().map(|folder| Setting::Neural(folder.clone()));
        let solvers = powers.map(Setting::Implicit).chain(models).map(|setting| Entry::Solver(Box::new(setting)));
        solvers.chain([Entry::Hold, Entry::Glide]).collect()
    }

    /// Rolls a solver out under recorded torques `[motion][frame][joint]`.
    fn rolled(&self, start: &Batch, solver: Box<dyn Solver>, torques: &[f64]) -> Result<(Places, f64, Vec<bool>)> {
        let (mut batch, mut solver) = (start.clone(), Timed::new(solver));
        let (n, joints) = (self.starts, batch.system.robot.joint_count());
        (0..n).for_each(|env| solver.reset(env));
        let (mut lost, mut places, mut tau) = (vec![false; n], Vec::with_capacity(self.frames), vec![0.0; n * joints]);
        for frame in 0..self.frames {
            for (env, tau) in tau.chunks_exact_mut(joints).enumerate() {
                tau.copy_from_slice(&torques[(env * self.frames + frame) * joints..][..joints]);
            }
            if let Err(error) = solver.step(&mut batch, &tau) {
                for fault in error.faults()? {
                    lost[fault.env] = true;
                    // It stays where it began, out of the way of overflow.
                    batch.reset(fault.env, start.state(fault.env));
                    solver.reset(fault.env);
                }
            }
            places.push((0..n).map(|env| points(&batch.system, batch.state(env))).collect());
        }
        Ok((places, each(solver.spent, n * self.frames), lost))
    }

    fn row(&self, entry: &Entry, start: &Batch, torques: &[f64], truth: &Places) -> Result<Row> {
        let (solver, series, substeps): (Box<dyn Solver>, _, _) = match entry {
            Entry::Hold => (Box::new(Hold), "hold last".to_string(), None),
            Entry::Glide => (Box::new(Glide), "constant velocity".to_string(), None),
            Entry::Solver(setting) => {
                let series = match &**setting {
                    Setting::Neural(folder) => describe(&ModelConfig::read(folder)?),
                    other => other.series().to_string(),
                };
                (setting.solver(&start.system)?, series, setting.substeps())
            }
        };
        let (places, microseconds, mut lost) = self.rolled(start, solver, torques)?;
        let distance = |frame: usize, env: usize| {
            let pairs = places[frame][env].iter().zip(&truth[frame][env]);
            mean(&pairs.map(|(a, b)| (a - b).norm()).collect::<Vec<_>>())
        };
        let over = |all: &mut dyn Iterator<Item = f64>| mean(&all.collect::<Vec<_>>());
        let curve: Vec<f64> = (0..self.frames).map(|frame| over(&mut (0..self.starts).map(|env| distance(frame, env)))).collect();
        let motions: Vec<f64> = (0..self.starts).map(|env| over(&mut (0..self.frames).map(|frame| distance(frame, env)))).collect();
        bounds::figures(&format!("{series}: its mean error"), &motions)?;
        // Farther off than anything of this size can be.
        let size = points(&start.system, start.state(0)).iter().map(|p| p.norm()).fold(0.0, f64::max);
        lost.iter_mut().zip(&motions).for_each(|(lost, error)| *lost |= *error > 10.0 * size);
        let microseconds = matches!(entry, Entry::Solver(_)).then_some(microseconds);
        Ok(Row { series, substeps, microseconds, curve, motions, lost: lost.iter().filter(|lost| **lost).count() })
    }
}

/// Where contact points are (m, world).
fn points(system: &System, state: &[f64]) -> Vec<Vector3<f64>> {
    let mut data = Data::new(&system.robot);
    kinematics(&system.robot, state, &mut data);
    system.robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
}

impl Experiment for Motions {
    type Data = Moved;

    fn name(&self) -> String {
        format!("motions-{}", Path::new(&self.robot).file_stem().unwrap_or_default().to_string_lossy())
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.entries().len() * self.starts * self.frames) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let system = System::named(&self.robot)?;
        let scene = system.spec.data_scene.clone().unwrap_or_else(|| "free".into());
        let mut inputs = Inputs(vec![Input::robot(&system), Input::motion(&self.robot, &scene, &Setting::Implicit(4))?]);
        for model in &self.model {
            Choice::model(model.clone()).inputs(&self.robot, &scene, &mut inputs)?;
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Moved> {
        let system = System::named(&self.robot)?;
        if system.robot.contact_points.is_empty() {
            refuse!("--robot {}: it has no contact point whose place could be measured; give it [[contact]] points", self.robot);
        }
        let (config, entries) = (self.config(), self.entries());
        bounds::memory(&[("--starts", self.starts), ("--frames", self.frames)], 64 * system.robot.state_dim())?;
        bounds::time(&[("--starts", self.starts), ("--frames", self.frames), ("4 x --substeps", 4 * self.substeps)])?;
        let finest = 4 * self.substeps;
        let bar = progress::bar("solvers", entries.len() as u64 + 1);
        bar.say(&format!("reference, x{finest}"));
        let recording = record(&system, &mut *Setting::Implicit(finest).solver(&system)?, &config, 0, self.starts)?;
        let start = begin(&system, &config, 0, self.starts)?;
        let d = system.robot.state_dim();
        let at = |frame: usize, env: usize| points(&system, &recording.states[(env * (self.frames + 1) + frame + 1) * d..][..d]);
        let truth: Places = (0..self.frames).map(|frame| (0..self.starts).map(|env| at(frame, env)).collect()).collect();
        let rows = on_one_core(|| {
            let mut rows = Vec::new();
            for (k, entry) in entries.iter().enumerate() {
                bar.set(k as u64 + 1);
                rows.push(self.row(entry, &start, &recording.torques, &truth)?);
            }
            Ok(rows)
        })?;
        bar.finish();
        Ok(Moved { robot: system.name.clone(), reference: format!("articulated, implicit, {finest} substeps"), rows })
    }

    fn tables(&self, data: &Moved) -> Result<Vec<Table>> {
        let shown: Vec<usize> = [10, 30, 100, 300, 1000].into_iter().filter(|frame| *frame <= self.frames).collect();
        let millimetres = |x: f64| digits(1e3 * x);
        let rows = data.rows.iter().map(|row| {
            let frames = shown.iter().map(|frame| millimetres(row.curve[frame - 1]));
            let of = |share: f64| millimetres(percentile(row.motions.clone(), share));
            let first = [
                row.series.clone(),
                row.substeps.map_or_else(|| "-".into(), |n| n.to_string()),
                row.microseconds.map_or_else(|| "-".into(), digits),
                millimetres(mean(&row.motions)),
                of(0.95),
                of(1.0),
            ];
            first.into_iter().chain(frames).chain([row.lost.to_string()]).collect()
        });
        let frames: Vec<String> = shown.iter().map(|frame| format!("frame {frame}")).collect();
        let header = ["solver", "substeps", "us a frame", "mean (mm)", "95 %", "worst"].into_iter();
        let header: Vec<&str> = header.chain(frames.iter().map(String::as_str)).chain(["lost"]).collect();
        let note = format!(
            "{}: distance of contact points over {} frames of {} motions that no solver has seen, from {}; 95 % and worst: of the motions' means.",
            data.robot, self.frames, self.starts, data.reference
        );
        Ok(vec![Table::new(&self.name(), &header).with(rows).noted(&note)])
    }

    fn pictures(&self, data: &Moved, stem: &Path) -> Result<()> {
        let mut series: Vec<Series> = Vec::new();
        for row in &data.rows {
            let Some(microseconds) = row.microseconds else { continue };
            let mark = (microseconds, mean(&row.motions), row.substeps.map_or_else(String::new, |n| format!("x{n}")));
            match series.last_mut().filter(|s| s.name == row.series) {
                Some(s) => s.points.push(mark),
                None => series.push(Series { name: row.series.clone(), points: vec![mark] }),
            }
        }
        let mut levels: Vec<(f64, String)> = Vec::new();
        for row in data.rows.iter().filter(|row| row.microseconds.is_none()) {
            let error = mean(&row.motions);
            // What starts at rest stays where it is at constant velocity, too.
            match levels.iter_mut().find(|(other, _)| (other / error - 1.0).abs() < 0.02) {
                Some((_, name)) => *name += &format!(", {}", row.series),
                None => levels.push((error, row.series.clone())),
            }
        }
        let figure = Figure {
            title: format!("{}: motions that no solver has seen", data.robot),
            x: "microseconds a frame, one environment, one core".into(),
            y: format!("mean distance of contact points over {} frames (m)", self.frames),
            series,
            front: Vec::new(),
            levels,
        };
        figure.save(stem)
    }
}
