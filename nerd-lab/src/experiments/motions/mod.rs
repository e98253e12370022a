//! Errors of contact points along unseen motions in new scenes, and the cost of a frame.
//!
//! Starts, scenes and torques are drawn as those of a data set ([`nerd_sim::dataset::begin`]), from a seed of their own. The reference is
//! the implicit step with four times as many substeps as the finest solver here. An error is the distance (m) of contact points, a
//! cable's nodes, averaged. Time and error come from the same frames. On a GPU many environments move together and are read every ten
//! frames.

mod shown;

use std::time::{Duration, Instant};

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::Real;
use nerd_sim::dataset::{GenerateConfig, Recording, begin, record};
use nerd_sim::instruments::{Glide, Hold};
#[cfg(feature = "cuda")]
use nerd_train::learner::cuda::Precision;
use rayon::prelude::*;

use super::cost::{each, on_one_core, powers};
use crate::choice::describe;
use crate::prelude::*;

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

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Moved {
    pub robot: String,
    pub reference: String,
    pub rows: Vec<Row>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub series: String,
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
/// Places, microseconds of a frame, and motions that could not be gone on with.
type Rolled = (Places, f64, Vec<bool>);

impl Motions {
    fn name(&self) -> String {
        let robot = Path::new(&self.robot).file_stem().unwrap_or_default().to_string_lossy();
        format!("{}-{robot}", if self.device == Device::Cuda { "device" } else { "motions" })
    }

    /// At every how many frames places are looked at.
    fn look(&self) -> usize {
        if self.device == Device::Cuda { LOOK } else { 1 }
    }

    fn together(&self) -> usize {
        self.environments.unwrap_or(CROWD).max(self.starts)
    }

    fn fits(&self) -> Result<()> {
        match self.device {
            Device::Cpu if self.environments.is_some() => bail!("--environments means nothing without --device cuda"),
            Device::Cuda if cfg!(not(feature = "cuda")) => bail!("--device cuda needs a build with `--features cuda`"),
            Device::Cuda if self.frames < LOOK => bail!("--frames {}: on a card they are looked at every {LOOK}", self.frames),
            Device::Cuda if self.environments.is_some_and(|n| n < self.starts) => {
                bail!("--environments: {} at least, a motion each (--starts)", self.starts)
            }
            _ => Ok(()),
        }
    }

    /// What is compared with the reference, beside two predictors that know no dynamics.
    fn settings(&self) -> Vec<Setting> {
        powers(self.substeps).map(Setting::Implicit).chain(self.model.iter().cloned().map(Setting::Neural)).collect()
    }

    /// Rolls a solver out under recorded torques `[motion][frame][joint]`, so many frames of all environments at a time by `roll`:
    /// places, microseconds of a frame, and motions that could not be gone on with.
    fn rolled<S: Solver + ?Sized>(
        &self,
        start: &Batch,
        solver: &mut S,
        roll: impl Fn(&mut S, &mut Batch, &[f64], usize) -> Result<(), StepError>,
        torques: &[f64],
    ) -> Result<Rolled> {
        let (look, joints, mut crowd) = (self.look(), start.system.robot.joint_count(), self.crowd(start));
        let (n, looks) = (crowd.len(), self.frames / look);
        // `[frame][env][joint]` up to a look.
        let part = |k: usize| -> Vec<f64> {
            let of = |frame: usize, env: usize| &torques[(env % self.starts * self.frames + frame) * joints..][..joints];
            (k * look..(k + 1) * look).flat_map(|frame| (0..n).flat_map(move |env| of(frame, env).iter().copied())).collect()
        };
        // The first frames make room for all others: they are rolled once before the clock runs, and thrown away.
        if let Err(error) = roll(solver, &mut crowd.clone(), &part(0), look) {
            error.faults()?;
        }
        (0..n).for_each(|env| solver.reset(env));
        let (mut lost, mut places, mut spent) = (vec![false; self.starts], Vec::with_capacity(looks), Duration::ZERO);
        for torques in (0..looks).map(part) {
            let began = Instant::now();
            let rolled = roll(solver, &mut crowd, &torques, look);
            spent += began.elapsed();
            if let Err(error) = rolled {
                for fault in error.faults()? {
                    lost[fault.env % self.starts] = true;
                    // It restarts, so that a frame costs as much as before, and does not count.
                    crowd.reset(fault.env, start.state(fault.env % self.starts));
                    solver.reset(fault.env);
                }
            }
            places.push((0..self.starts).map(|env| points(&crowd.system, crowd.state(env))).collect());
        }
        Ok((places, each(spent, n * looks * look), lost))
    }

    fn stepped(&self, start: &Batch, mut solver: Box<dyn Solver>, torques: &[f64]) -> Result<Rolled> {
        fn steps(solver: &mut Box<dyn Solver>, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError> {
            let width = torques.len() / frames;
            (0..frames).try_for_each(|frame| solver.step(batch, &torques[frame * width..][..width]))
        }
        self.rolled(start, &mut solver, steps, torques)
    }

    /// The motions' starts; on a card in turn.
    fn crowd(&self, start: &Batch) -> Batch {
        let n = if self.device == Device::Cuda { self.together() } else { self.starts };
        let mut crowd = Batch::new(&start.system, &start.scenes[0], n);
        for env in 0..n {
            crowd.reset(env, start.state(env % self.starts));
            crowd.scenes[env] = Arc::clone(&start.scenes[env % self.starts]);
        }
        crowd
    }

    /// The rows of a solver: on a card a model has one in f32 and one in TF32.
    fn rows(&self, setting: &Setting, start: &Batch, torques: &[f64], truth: &Places) -> Result<Vec<Row>> {
        let series = match setting {
            Setting::Neural(folder) => describe(&ModelConfig::read(folder)?),
            other => other.series().to_string(),
        };
        #[cfg(feature = "cuda")]
        if self.device == Device::Cuda {
            let all = [(Precision::F32, ""), (Precision::Tf32, ", TF32")];
            let products = if matches!(setting, Setting::Neural(_)) { &all[..] } else { &all[..1] };
            let row = |(precision, word): &(Precision, &str)| {
                let mut solver = nerd_train::device::resident(setting, &start.system, Real::F32, *precision)?;
                let rolled = self.rolled(start, &mut *solver, |s, batch, torques, frames| s.roll(batch, torques, frames), torques)?;
                self.row(&(series.clone() + word), Some(setting), rolled, truth)
            };
            return products.iter().map(row).collect();
        }
        Ok(vec![self.row(&series, Some(setting), self.stepped(start, setting.solver(&start.system)?, torques)?, truth)?])
    }

    pub fn moved(&self) -> Result<Moved> {
        self.fits()?;
        let system = System::named(&self.robot)?;
        if system.robot.contact_points.is_empty() {
            bail!("--robot {}: it has no contact point whose place could be measured; give it [[contact]] points", self.robot);
        }
        let (Self { starts, frames, seed, .. }, settings) = (self.clone(), self.settings());
        let config = GenerateConfig { transitions: starts * frames, frames, seed, ..GenerateConfig::default() };
        let finest = 4 * self.substeps;
        bounds::memory(&[("--starts", starts), ("--frames", frames)], 64 * system.robot.state_dim())?;
        bounds::time(&[("--starts", starts), ("--frames", frames), ("4 x --substeps", finest)])?;
        let bar = progress::bar("solvers", settings.len() as u64 + 1);
        bar.say(&format!("reference, x{finest}"));
        // One by one: a batch of a few motions would keep a core or two busy.
        let one = |env: usize| Ok(record(&system, &mut *Setting::Implicit(finest).solver(&system)?, &config, env as u64, 1)?);
        let recordings: Vec<Recording> = (0..starts).into_par_iter().map(one).collect::<Result<_>>()?;
        let torques: Vec<f64> = recordings.iter().flat_map(|own| own.torques.iter().copied()).collect();
        let start = begin(&system, &config, 0, starts)?;
        let d = system.robot.state_dim();
        let at = |frame: usize, env: usize| points(&system, &recordings[env].states[(frame + 1) * d..][..d]);
        let looked = (1..=frames / self.look()).map(|k| k * self.look() - 1);
        let truth: Places = looked.map(|frame| (0..starts).map(|env| at(frame, env)).collect()).collect();
        let rows = on_one_core(|| {
            let mut rows = Vec::new();
            for (k, setting) in settings.iter().enumerate() {
                bar.set(k as u64 + 1);
                rows.extend(self.rows(setting, &start, &torques, &truth)?);
            }
            let floors: [(&str, Box<dyn Solver>); 2] = [("hold last", Box::new(Hold)), ("constant velocity", Box::new(Glide))];
            for (name, floor) in floors {
                rows.push(self.row(name, None, self.stepped(&start, floor, &torques)?, &truth)?);
            }
            Ok(rows)
        })?;
        bar.finish();
        Ok(Moved { robot: system.name.clone(), reference: format!("articulated, implicit, {finest} substeps"), rows })
    }

    fn row(&self, series: &str, setting: Option<&Setting>, (places, microseconds, lost): Rolled, truth: &Places) -> Result<Row> {
        let (curve, motions) = distances(&places, truth, &lost, setting.is_some());
        bounds::figures(&format!("{series}: its mean error"), &motions)?;
        let (lost, substeps) = (self.starts - motions.len(), setting.and_then(Setting::substeps));
        Ok(Row { series: series.into(), substeps, microseconds: setting.map(|_| microseconds), curve, motions, lost })
    }
}

/// Mean distance (m) by frame, and by motion, of all that are not lost. What is too far off is, too, unless it knows no dynamics and may
/// be.
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
    fn about(&self) -> Result<About> {
        let system = System::named(&self.robot)?;
        let scene = system.spec.data_scene.clone().unwrap_or_else(|| "free".into());
        let mut inputs = Inputs(vec![Input::robot(&system), Input::motion(&self.robot, &scene, &Setting::Implicit(4))?]);
        self.model.iter().try_for_each(|model| Input::model(model).map(|model| inputs.add(model)))?;
        let effort = ((self.settings().len() + 2) * self.starts * self.frames) as f64;
        Ok(About { name: self.name(), seed: self.seed, effort, inputs })
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
