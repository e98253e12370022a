//! What settings cost on the device, and how accurate they are there.

use std::path::Path;
use std::time::Instant;

use crate::mujoco::{Referee, Scheme};
use nerd_core::state::difference;
use nerd_model::pick::Setting;
use nerd_sim::articulated::device::Real;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use super::{cell, idle};
use crate::error::Result;
use crate::report::table::digits;
use nerd_train::device::resident;
use nerd_train::learner::cuda::Precision;

/// Frames of a rollout whose error is measured, and at every how many of them it is looked at.
pub(super) const FRAMES: usize = 100;
const LOOK: usize = 10;
/// Most steps of MuJoCo Warp in a frame; its reference has four times as many.
const STEPS: usize = 32;

/// One setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pace {
    /// Robot and scene.
    pub of: String,
    /// The solver, as a legend has it.
    pub series: String,
    /// Which of the series.
    pub label: String,
    /// Mean distance (rad, m) from the reference over a rollout: the CPU's solver, the device's.
    pub errors: [Option<f64>; 2],
    /// Frames a second of all environments: the CPU's on all cores, the device's.
    pub frames: [Option<f64>; 2],
    /// Environments of the timed batch that were given up.
    pub lost: usize,
    /// Whether no other of the robot beats it in both.
    pub front: bool,
}

/// Our solvers, analytic and learned.
pub(super) fn measure(of: &str, settings: &[Setting], batch: &Batch, rollouts: usize, environments: usize) -> Result<Vec<Pace>> {
    let system = &batch.system;
    let truth = course(&mut Articulated::new(ArticulatedConfig::converged(Friction::Coulomb)), few(batch, rollouts))?;
    let mut paces = Vec::new();
    for setting in settings {
        let precisions: &[Precision] =
            if matches!(setting, Setting::Neural(_)) { &[Precision::F32, Precision::Tf32] } else { &[Precision::F32] };
        for precision in precisions {
            let (mut cpu, mut device) = (setting.solver(system)?, resident(setting, system, Real::F32, *precision)?);
            let alone = *precision == Precision::F32;
            let error = |states: Vec<Vec<f64>>| Some(distance(system, &truth, &states));
            let errors = [
                if alone { error(course(&mut *cpu, few(batch, rollouts))?) } else { None },
                error(course(&mut *device, few(batch, rollouts))?),
            ];
            let mut many = few(batch, environments);
            // Kernels are compiled and memory taken once.
            let torques = idle(&many);
            left(device.roll(&mut many, &torques, 1))?;
            let mut one = many.clone();
            let on_cpu = if alone {
                let looks = || (0..LOOK).try_for_each(|_| left(cpu.step(&mut one, &torques)).map(drop));
                Some(timed(environments * LOOK, looks)?)
            } else {
                None
            };
            let mut lost = 0;
            let on_device = timed(environments * FRAMES, || {
                lost = left(device.roll(&mut many, &torques, FRAMES))?;
                Ok(())
            })?;
            let label = match setting {
                Setting::Neural(folder) => {
                    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    if alone { name } else { format!("{name}, TF32") }
                }
                other => format!("x{}", other.substeps().unwrap_or(1)),
            };
            let series = setting.series().into();
            paces.push(Pace { of: of.into(), series, label, errors, frames: [on_cpu, Some(on_device)], lost, front: false });
        }
    }
    Ok(paces)
}

/// MuJoCo Warp: its version, and its steps a frame against a run of its own.
pub(super) fn guests(of: &str, python: &Path, batch: &Batch, rollouts: usize, environments: usize) -> Result<(String, Vec<Pace>)> {
    let system = &batch.system;
    let mut warp = Referee::warp(python, &few(batch, rollouts), FRAMES)?;
    warp.worlds = environments;
    let looks = |frames: Vec<Vec<f64>>| -> Vec<Vec<f64>> { frames.into_iter().skip(LOOK - 1).step_by(LOOK).collect() };
    let mut paces = Vec::new();
    // Where nothing is damped, implicitfast is Euler.
    for (plain, series) in [(false, "MuJoCo Warp"), (true, "MuJoCo Warp, its default friction")] {
        warp.plain = plain;
        let truth = looks(warp.play(Scheme::Euler, 4 * STEPS, false)?.frames);
        for steps in std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n <= STEPS) {
            let played = warp.play(Scheme::Euler, steps, true)?;
            let error = distance(system, &truth, &looks(played.frames));
            let frames = (environments * FRAMES) as f64 / played.seconds;
            let (of, series, label) = (of.into(), series.into(), format!("x{steps}"));
            paces.push(Pace {
                of,
                series,
                label,
                errors: [None, Some(error)],
                frames: [None, Some(frames)],
                lost: played.lost,
                front: false,
            });
        }
    }
    Ok((warp.version.clone(), paces))
}

/// Marks what nothing else of the same robot beats in both.
pub(super) fn mark(paces: &mut [Pace]) {
    for i in 0..paces.len() {
        let beaten = |p: &Pace| {
            p.lost == 0
                && match (p.errors[1], p.frames[1], paces[i].errors[1], paces[i].frames[1]) {
                    (Some(e), Some(f), Some(own), Some(fast)) => p.of == paces[i].of && e <= own && f >= fast && (e < own || f > fast),
                    _ => false,
                }
        };
        paces[i].front = paces[i].lost == 0 && !paces.iter().any(beaten);
    }
}

/// As many environments as are asked for, from the states of a batch in turn.
fn few(batch: &Batch, n: usize) -> Batch {
    let mut part = Batch::new(&batch.system, &batch.scenes[0], n);
    let d = batch.system.robot.state_dim();
    part.states.chunks_exact_mut(d).zip(batch.states.chunks_exact(d).cycle()).for_each(|(to, from)| to.copy_from_slice(from));
    part
}

/// How many environments could not be stepped; they stand where they stood.
fn left(stepped: Result<(), StepError>) -> Result<usize> {
    Ok(stepped.err().map_or(Ok(Vec::new()), StepError::faults)?.len())
}

/// So much work a second.
fn timed(work: usize, run: impl FnOnce() -> Result<()>) -> Result<f64> {
    let began = Instant::now();
    run()?;
    Ok(work as f64 / began.elapsed().as_secs_f64())
}

/// States at every so many frames of a rollout.
fn course(solver: &mut dyn Solver, mut batch: Batch) -> Result<Vec<Vec<f64>>> {
    let torques = idle(&batch);
    let look = |_| {
        (0..LOOK).try_for_each(|_| left(solver.step(&mut batch, &torques)).map(drop))?;
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

impl Pace {
    /// Microseconds of a frame of one environment, among all of them.
    pub(super) fn microseconds(&self) -> Option<f64> {
        self.frames[1].map(|frames| 1e6 / frames)
    }

    /// A row of the table.
    pub(super) fn cells(&self) -> Vec<String> {
        let [slow, fast] = self.frames.map(|f| f.map_or_else(|| "-".into(), digits));
        let [cpu, device] = self.errors.map(cell);
        let front = if self.front { "*" } else { "" }.into();
        let (solver, lost) = (format!("{} {}", self.series, self.label), self.lost.to_string());
        vec![self.of.clone(), solver, cpu, device, slow, fast, cell(self.microseconds()), lost, front]
    }
}
