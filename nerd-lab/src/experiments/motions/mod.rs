//! Along motions that no solver has seen, in scenes laid out anew: how far a robot's contact points are from where they should be, and what a
//! frame costs.
//!
//! Starts, scenes and torques are drawn as those of a data set ([`nerd_sim::dataset::begin`]), from a seed of their own. The reference is
//! the implicit step with four times as many substeps as the finest solver here. An error is the distance (m) of contact points, a
//! cable's nodes say, averaged over them. Time and error come from the same frames. On a card many environments move together, and are looked at
//! after every tenth frame.

#[cfg(feature = "cuda")]
mod card;
mod shown;

use std::path::{Path, PathBuf};
use std::time::Duration;

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_model::folder::ModelConfig;
use nerd_model::pick::Setting;
use nerd_sim::dataset::{GenerateConfig, Recording, begin, record};
use nerd_sim::instruments::{Glide, Hold, Timed};
use nerd_sim::prelude::*;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cost::{each, on_one_core};
use super::{Experiment, Measured};
use crate::error::{Result, refuse};
use crate::report::replay::Replay;
use crate::report::{Input, Inputs, motions};
use nerd_train::bounds::{self, FRAMES, SEEDS, STARTS};
use nerd_train::choice::{Choice, describe};
use nerd_train::device::Device;
#[cfg(feature = "cuda")]
use nerd_train::learner::cuda::Precision;
use nerd_train::progress;
use nerd_train::settings::settings;
use nerd_train::stats::mean;

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
        /// Where solvers move
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// Environments that move together, the motions in turn; with --device cuda alone [default: 4096]
        environments: Option<usize> = None, Whole(STARTS);
    }
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Moved {
    pub robot: String,
    pub reference: String,
    pub rows: Vec<Row>,
}

/// One solver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub series: String,
    /// Substeps a frame, of an analytic one.
    pub substeps: Option<usize>,
    /// Frame of one environment on one core; none of what knows no dynamics.
    pub microseconds: Option<f64>,
    /// Mean distance (m) by frame that was looked at, of motions that are not lost; empty if all are.
    pub curve: Vec<f64>,
    /// Mean distance (m) of each motion that is not lost.
    pub motions: Vec<f64>,
    /// Motions that left or could not be gone on with: no other figure counts them.
    pub lost: usize,
}

/// Environments that move together on a card, and at every how many frames they are looked at there.
const CROWD: usize = 4096;
const LOOK: usize = 10;

/// So many times as far as anything goes in the reference, a motion is lost.
const FAR: f64 = 10.0;

/// Places of contact points by frame that was looked at, and motion.
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

    /// The first motion in the first model, and in the truth that this learned.
    pub fn replay(&self) -> Result<Replay> {
        let Some(model) = self.model.first() else { refuse!("--replay shows a model beside its truth: name one with --model") };
        bounds::memory(&[("--frames", self.frames)], 256 * System::named(&self.robot)?.robot.links.len())?;
        motions::driven(&self.robot, model, self.frames, self.seed)
    }

    /// At every how many frames places are looked at.
    fn look(&self) -> usize {
        if self.device == Device::Cuda { LOOK } else { 1 }
    }

    /// Environments that move together.
    fn together(&self) -> usize {
        self.environments.unwrap_or(CROWD).max(self.starts)
    }

    /// Refuses what does not fit together.
    fn fits(&self) -> Result<()> {
        match self.device {
            Device::Cpu if self.environments.is_some() => refuse!("--environments means nothing without --device cuda"),
            Device::Cuda if cfg!(not(feature = "cuda")) => refuse!("--device cuda needs a build with `--features cuda`"),
            Device::Cuda if self.frames < LOOK => refuse!("--frames {}: on a card they are looked at every {LOOK}", self.frames),
            Device::Cuda if self.environments.is_some_and(|n| n < self.starts) => {
                refuse!("--environments: {} at least, a motion each (--starts)", self.starts)
            }
            _ => Ok(()),
        }
    }

    fn entries(&self) -> Vec<Entry> {
        let powers = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n <= self.substeps);
        let models = self.model.iter().map(|folder| Setting::Neural(folder.clone()));
        let solvers = powers.map(Setting::Implicit).chain(models).map(|setting| Entry::Solver(Box::new(setting)));
        solvers.chain([Entry::Hold, Entry::Glide]).collect()
    }

    /// Rolls a solver out under recorded torques `[motion][frame][joint]`: places, microseconds of a frame, and motions that could not be gone
    /// on with.
    fn rolled(&self, start: &Batch, solver: Box<dyn Solver>, torques: &[f64]) -> Result<(Places, f64, Vec<bool>)> {
        let (mut batch, mut solver) = (start.clone(), Timed::new(solver));
        let (n, joints) = (self.starts, batch.system.robot.joint_count());
        let (mut lost, mut places, mut tau) = (vec![false; n], Vec::with_capacity(self.frames), vec![0.0; n * joints]);
        // The first frame makes room for all others: it is stepped once before the clock runs, and thrown away.
        if let Err(error) = solver.step(&mut start.clone(), &tau) {
            error.faults()?;
        }
        solver.spent = Duration::ZERO;
        (0..n).for_each(|env| solver.reset(env));
        for frame in 0..self.frames {
            for env in 0..n {
                tau[env * joints..][..joints].copy_from_slice(&torques[(env * self.frames + frame) * joints..][..joints]);
            }
            if let Err(error) = solver.step(&mut batch, &tau) {
                for fault in error.faults()? {
                    lost[fault.env] = true;
                    // It begins anew, so that a frame costs as much as before, and counts no more.
                    batch.reset(fault.env, start.state(fault.env));
                    solver.reset(fault.env);
                }
            }
            if (frame + 1).is_multiple_of(self.look()) {
                places.push((0..n).map(|env| points(&batch.system, batch.state(env))).collect());
            }
        }
        Ok((places, each(solver.spent, n * self.frames), lost))
    }

    /// The rows of an entry: on a card a model has one in f32 and one in TF32.
    fn rows(&self, entry: &Entry, start: &Batch, torques: &[f64], truth: &Places) -> Result<Vec<Row>> {
        let setting = match entry {
            Entry::Hold => return Ok(vec![self.row("hold last", None, self.rolled(start, Box::new(Hold), torques)?, truth)?]),
            Entry::Glide => return Ok(vec![self.row("constant velocity", None, self.rolled(start, Box::new(Glide), torques)?, truth)?]),
            Entry::Solver(setting) => &**setting,
        };
        let series = match setting {
            Setting::Neural(folder) => describe(&ModelConfig::read(folder)?),
            other => other.series().to_string(),
        };
        #[cfg(feature = "cuda")]
        if self.device == Device::Cuda {
            let row = |(precision, word): &(Precision, &str)| {
                let rolled = self.rolled_there(start, (setting, *precision), torques)?;
                self.row(&(series.clone() + word), Some(setting), rolled, truth)
            };
            return card::products(setting).iter().map(row).collect();
        }
        let rolled = self.rolled(start, setting.solver(&start.system)?, torques)?;
        Ok(vec![self.row(&series, Some(setting), rolled, truth)?])
    }

    /// Rolls all out.
    pub fn moved(&self) -> Result<Moved> {
        self.fits()?;
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
        // One by one: a batch of a few motions would keep a core or two busy.
        let one = |env: usize| Ok(record(&system, &mut *Setting::Implicit(finest).solver(&system)?, &config, env as u64, 1)?);
        let recordings: Vec<Recording> = (0..self.starts).into_par_iter().map(one).collect::<Result<_>>()?;
        let torques: Vec<f64> = recordings.iter().flat_map(|own| own.torques.iter().copied()).collect();
        let start = begin(&system, &config, 0, self.starts)?;
        let d = system.robot.state_dim();
        let at = |frame: usize, env: usize| points(&system, &recordings[env].states[(frame + 1) * d..][..d]);
        let looked = (1..=self.frames / self.look()).map(|k| k * self.look() - 1);
        let truth: Places = looked.map(|frame| (0..self.starts).map(|env| at(frame, env)).collect()).collect();
        let rows = on_one_core(|| {
            let mut rows = Vec::new();
            for (k, entry) in entries.iter().enumerate() {
                bar.set(k as u64 + 1);
                rows.extend(self.rows(entry, &start, &torques, &truth)?);
            }
            Ok(rows)
        })?;
        bar.finish();
        Ok(Moved { robot: system.name.clone(), reference: format!("articulated, implicit, {finest} substeps"), rows })
    }

    fn row(
        &self,
        series: &str,
        setting: Option<&Setting>,
        (places, microseconds, lost): (Places, f64, Vec<bool>),
        truth: &Places,
    ) -> Result<Row> {
        let (curve, motions) = distances(&places, truth, &lost, setting.is_some());
        bounds::figures(&format!("{series}: its mean error"), &motions)?;
        let (lost, substeps) = (self.starts - motions.len(), setting.and_then(Setting::substeps));
        Ok(Row { series: series.into(), substeps, microseconds: setting.map(|_| microseconds), curve, motions, lost })
    }
}

/// Mean distance (m) by frame, and by motion, of all that are not lost. What is too far off is, too, unless it knows no dynamics and may be.
fn distances(places: &Places, truth: &Places, lost: &[bool], solves: bool) -> (Vec<f64>, Vec<f64>) {
    let distance = |frame: usize, env: usize| {
        let pairs = places[frame][env].iter().zip(&truth[frame][env]);
        mean(&pairs.map(|(a, b)| (a - b).norm()).collect::<Vec<_>>())
    };
    let (frames, size) = (places.len(), truth.iter().flatten().flatten().map(|p| p.norm()).fold(0.0, f64::max));
    let left = |env: usize| solves && (0..frames).any(|frame| distance(frame, env) > FAR * size);
    let kept: Vec<usize> = (0..lost.len()).filter(|env| !lost[*env] && !left(*env)).collect();
    let over = |all: &mut dyn Iterator<Item = f64>| mean(&all.collect::<Vec<_>>());
    let curve = |frame: usize| over(&mut kept.iter().map(|env| distance(frame, *env)));
    let curve = (0..frames).filter(|_| !kept.is_empty()).map(curve).collect();
    (curve, kept.iter().map(|env| over(&mut (0..frames).map(|frame| distance(frame, *env)))).collect())
}

/// Where contact points are (m, world).
fn points(system: &System, state: &[f64]) -> Vec<Vector3<f64>> {
    let mut data = Data::new(&system.robot);
    kinematics(&system.robot, state, &mut data);
    system.robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
}

impl Experiment for Motions {
    fn name(&self) -> String {
        let robot = Path::new(&self.robot).file_stem().unwrap_or_default().to_string_lossy();
        format!("{}-{robot}", if self.device == Device::Cuda { "device" } else { "motions" })
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
            inputs.solver(&Choice::model(model.clone()), &self.robot, &scene)?;
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Measured> {
        let data = self.moved()?;
        Ok(Measured::new(&data, vec![self.table(&data)])?.with("figure", self.figure(&data)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three motions of one point over two frames, of which the solver loses one, and one leaves for a moment.
    #[test]
    fn what_is_lost_is_in_no_mean() {
        let at = |x: f64| vec![Vector3::new(x, 0.0, 0.0)];
        let truth = vec![vec![at(1.0), at(1.0), at(1.0)], vec![at(1.0), at(1.0), at(1.0)]];
        let places = vec![vec![at(1.1), at(1.0), at(1.3)], vec![at(1.2), at(5.0), at(50.0)]];
        let (curve, motions) = distances(&places, &truth, &[false, true, false], true);
        assert!(curve.len() == 2 && (curve[0] - 0.1).abs() < 1e-12 && (curve[1] - 0.2).abs() < 1e-12, "{curve:?}");
        assert!(motions.len() == 1 && (motions[0] - 0.15).abs() < 1e-12, "{motions:?}");
        assert_eq!(distances(&places, &truth, &[false; 3], false).1.len(), 3, "what knows no dynamics may go anywhere");
        assert_eq!(distances(&places, &truth, &[true; 3], true), (Vec::new(), Vec::new()));
    }
}
