//! The articulated solver on a GPU beside the CPU's: how far apart they are, how accurate they are, and what a frame costs.

use std::sync::Arc;
use std::time::Instant;

use nerd_core::state::difference;
use nerd_model::pick::Setting;
use nerd_sim::articulated::device::{CudaArticulated, Real};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Experiment;

use crate::error::Result;
use crate::progress::bar;
use crate::report::table::digits;
use crate::report::{Input, Inputs, Table};

/// Frames after which most robots touch something.
const FALL: usize = 25;
/// Frames of a rollout whose error is measured, and at every how many of them it is looked at.
const FRAMES: usize = 100;
const LOOK: usize = 10;
/// Difference beyond which a state of 32 bits counts as apart.
const NEAR: f64 = 1e-4;

/// The experiment.
#[derive(Clone, Debug)]
pub struct OnDevice {
    /// Robots with their scenes.
    pub robots: Vec<(String, String)>,
    /// States from which one frame is compared.
    pub states: usize,
    /// Rollouts whose error is measured.
    pub rollouts: usize,
    /// Environments of the timed batch.
    pub environments: usize,
    /// Substeps of the implicit step that are timed.
    pub substeps: Vec<usize>,
    /// Seed of the starts.
    pub seed: u64,
}

/// One frame from the same states, on the device and on the CPU.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parity {
    /// Robot and scene.
    pub of: String,
    /// Share of the states in which something touches.
    pub touching: f64,
    /// The largest difference of a number, relative to 1 + its size, with 64 bits.
    pub double: f64,
    /// With 32 bits: that, its median over states, and the share of states beyond 1e-4.
    pub single: [f64; 3],
}

/// One setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pace {
    /// Robot and scene.
    pub of: String,
    /// Substeps of the implicit step.
    pub substeps: usize,
    /// Mean distance (rad, m) from `converged` over a rollout: the CPU's solver, the device's.
    pub errors: [f64; 2],
    /// Frames a second of all environments: the CPU's on all cores, the device's.
    pub frames: [f64; 2],
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Data {
    /// One a robot.
    pub parities: Vec<Parity>,
    /// One a robot and setting.
    pub paces: Vec<Pace>,
}

impl OnDevice {
    /// Starts, each after a fall.
    fn starts(&self, system: &Arc<System>, scene: &str, n: usize) -> Result<Batch> {
        let mut batch = Batch::new(system, &system.scene(scene)?, n);
        let drawn: Vec<Vec<f64>> =
            (0..n as u64).into_par_iter().map(|env| start(system, Start::Sample, &mut stream(self.seed, env))).collect();
        drawn.iter().enumerate().for_each(|(env, state)| batch.reset(env, state));
        roll(&mut Articulated::new(ArticulatedConfig::accurate(system)), &mut batch, FALL)?;
        Ok(batch)
    }

    fn parity(&self, of: String, batch: &Batch) -> Result<Parity> {
        let (system, d) = (&batch.system, batch.system.robot.state_dim());
        let config = ArticulatedConfig::accurate(system);
        let gains: Vec<f64> = system.joint_specs().map(|j| j.torque / 4.0).collect();
        let torques: Vec<f64> = (0..batch.len() * gains.len()).map(|k| gains[k % gains.len()] * (k as f64 * 0.7).sin()).collect();
        let mut cpu = batch.clone();
        cpu.watch();
        Articulated::new(config).step(&mut cpu, &torques)?;
        let touching = (0..cpu.len()).filter(|env| cpu.forces_on(*env).iter().any(|f| f.norm() > 0.0)).count() as f64;
        let apart = |real: Real| -> Result<Vec<f64>> {
            let mut device = batch.clone();
            CudaArticulated::new(config, real).step(&mut device, &torques)?;
            let largest = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
            let mut all: Vec<f64> = device.states.chunks_exact(d).zip(cpu.states.chunks_exact(d)).map(largest).collect();
            all.sort_by(f64::total_cmp);
            Ok(all)
        };
        let (double, single) = (apart(Real::F64)?, apart(Real::F32)?);
        let last = |all: &[f64]| all.last().copied().unwrap_or(0.0);
        let beyond = single.iter().filter(|x| **x > NEAR).count() as f64 / single.len() as f64;
        Ok(Parity {
            of,
            touching: touching / batch.len() as f64,
            double: last(&double),
            single: [last(&single), single[single.len() / 2], beyond],
        })
    }

    /// Errors and times by substeps.
    fn paces(&self, of: &str, batch: &Batch, step: &mut dyn FnMut()) -> Result<Vec<Pace>> {
        let few = |n: usize| {
            let mut part = Batch::new(&batch.system, &batch.scenes[0], n);
            let d = batch.system.robot.state_dim();
            part.states.chunks_exact_mut(d).zip(batch.states.chunks_exact(d).cycle()).for_each(|(to, from)| to.copy_from_slice(from));
            part
        };
        let truth = course(&mut Articulated::new(ArticulatedConfig::converged(Friction::Coulomb)), few(self.rollouts))?;
        let pace = |&substeps: &usize| {
            step();
            let config = ArticulatedConfig::implicit(substeps, Friction::Coulomb);
            let (mut cpu, mut device) = (Articulated::new(config), CudaArticulated::new(config, Real::F32));
            let errors = [course(&mut cpu, few(self.rollouts))?, course(&mut device, few(self.rollouts))?];
            let errors = errors.map(|states| distance(&batch.system, &truth, &states));
            let mut many = few(self.environments);
            // Kernels are compiled and memory taken once.
            let torques = idle(&many);
            device.roll(&mut many, &torques, 1)?;
            let timed = |frames: usize, work: &mut dyn FnMut(usize) -> Result<()>| -> Result<f64> {
                let began = Instant::now();
                work(frames)?;
                Ok((self.environments * frames) as f64 / began.elapsed().as_secs_f64())
            };
            let mut one = many.clone();
            let on_cpu = timed(LOOK, &mut |frames| roll(&mut cpu, &mut one, frames))?;
            let on_device = timed(FRAMES, &mut |frames| Ok(device.roll(&mut many, &torques, frames)?))?;
            Ok(Pace { of: of.into(), substeps, errors, frames: [on_cpu, on_device] })
        };
        self.substeps.iter().map(pace).collect()
    }
}

/// No torques.
fn idle(batch: &Batch) -> Vec<f64> {
    vec![0.0; batch.len() * batch.system.robot.joint_count()]
}

fn roll(solver: &mut dyn Solver, batch: &mut Batch, frames: usize) -> Result<()> {
    let torques = idle(batch);
    (0..frames).try_for_each(|_| Ok(solver.step(batch, &torques)?))
}

/// States at every so many frames of a rollout.
fn course(solver: &mut dyn Solver, mut batch: Batch) -> Result<Vec<Vec<f64>>> {
    let look = |_| {
        roll(solver, &mut batch, LOOK)?;
        Ok(batch.states.clone())
    };
    (0..FRAMES / LOOK).map(look).collect()
}

/// Mean length of the way between configurations.
fn distance(system: &System, truth: &[Vec<f64>], states: &[Vec<f64>]) -> f64 {
    let (robot, d) = (&system.robot, system.robot.state_dim());
    let mut way = vec![0.0; robot.nv()];
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in truth.iter().zip(states).flat_map(|(a, b)| a.chunks_exact(d).zip(b.chunks_exact(d))) {
        difference(robot, &a[..robot.nq()], &b[..robot.nq()], &mut way);
        sum += way.iter().map(|x| x.abs()).sum::<f64>() / way.len() as f64;
        count += 1.0;
    }
    sum / count
}

impl Experiment for OnDevice {
    type Data = Data;

    fn name(&self) -> String {
        "device".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.robots.len() * (self.states + self.rollouts * FRAMES + self.environments * FRAMES)) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for (robot, scene) in &self.robots {
            let system = System::named(robot)?;
            inputs.add(Input::robot(&system));
            inputs.add(Input::motion(robot, scene, &Setting::Accurate)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Data> {
        let bar = bar("settings", (self.robots.len() * (1 + self.substeps.len())) as u64);
        let (mut done, mut data) = (0, Data { parities: Vec::new(), paces: Vec::new() });
        let mut step = || {
            done += 1;
            bar.set(done);
        };
        for (robot, scene) in &self.robots {
            let (system, of) = (System::named(robot)?, format!("{robot}, {scene}"));
            let batch = self.starts(&system, scene, self.states)?;
            data.parities.push(self.parity(of.clone(), &batch)?);
            step();
            data.paces.extend(self.paces(&of, &batch, &mut step)?);
        }
        bar.finish();
        Ok(data)
    }

    fn tables(&self, data: &Data) -> Result<Vec<Table>> {
        let parity = |p: &Parity| {
            let percent = |x: f64| format!("{:.1}", 100.0 * x);
            let [single, median, beyond] = p.single;
            vec![
                p.of.clone(),
                percent(p.touching),
                format!("{:.1e}", p.double),
                format!("{single:.1e}"),
                format!("{median:.1e}"),
                percent(beyond),
            ]
        };
        let header =
            ["robot, scene", "touching (%)", "64 bits, largest", "32 bits, largest", "32 bits, median", "32 bits, beyond 1e-4 (%)"];
        let note = format!(
            "One frame of preset `accurate` from the same {} states, {FALL} frames after a start, under random torques: difference of the \
             device's state from the CPU's, by number relative to 1 + its size; largest over the numbers of a state.",
            self.states
        );
        let parities = Table::new("parity", &header).with(data.parities.iter().map(parity)).noted(&note);
        let pace = |p: &Pace| {
            let ([cpu, device], [slow, fast]) = (p.errors, p.frames);
            let times = [digits(slow), digits(fast), digits(1e6 / fast), format!("{:.1}", fast / slow)];
            [p.of.clone(), p.substeps.to_string(), digits(cpu), digits(device)].into_iter().chain(times).collect()
        };
        let header = [
            "robot, scene",
            "substeps",
            "error, CPU (rad, m)",
            "error, device",
            "frames/s, CPU",
            "frames/s, device",
            "us a frame, device",
            "ratio",
        ];
        let note = format!(
            "Implicit step, no torques. Error: mean distance of configurations from `converged` over {FRAMES} frames, {} rollouts. Frames/s: \
             {} environments together, on all cores of the CPU over {LOOK} frames with 64 bits, and on the device, which holds them for {FRAMES} \
             frames, with 32 bits; transfers there and back are counted.",
            self.rollouts, self.environments
        );
        Ok(vec![parities, Table::new("pace", &header).with(data.paces.iter().map(pace)).noted(&note)])
    }
}
