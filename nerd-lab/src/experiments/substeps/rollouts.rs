//! Rollouts of the truth at other numbers of substeps, and from starts that are shaken.

use std::sync::Arc;

use nerd_core::dynamics::{to_local, to_world};
use nerd_core::state::{quaternion, vector, write_quaternion};
use nerd_sim::instruments::{Recorder, Replay};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{normal, stream};
use rand::Rng;
use serde::{Deserialize, Serialize};

use super::{at, taken};
use crate::error::Result;
use crate::report::Table;
use crate::report::table::{digits, pair};
use nerd_train::bounds;
use nerd_train::evaluate::{Action, PassiveConfig, passive, summary};
use nerd_train::stats::mean;

/// Substeps of what is called converged.
pub(super) const MOST: usize = 128;
/// Times the truth's substeps that are held against the converged motion.
const LADDER: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// How far two ways to step are apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Apart {
    /// Mean |difference| over frames and rollouts: position (m) and orientation (rad) of a floating root, then joints (rad or m),
    /// of more than two their mean.
    pub error: Vec<f64>,
    /// Its standard error over rollouts.
    pub standard_error: Vec<f64>,
    /// Rollouts that left.
    pub diverged: usize,
}

impl Apart {
    /// Mean over quantities.
    pub fn mean(&self) -> f64 {
        mean(&self.error)
    }
}

/// A robot in a scene under a drive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rolled {
    /// Robot.
    pub robot: String,
    /// Scene.
    pub scene: String,
    /// Trajectories, frames and drive.
    pub protocol: PassiveConfig,
    /// Substeps of the truth.
    pub substeps: usize,
    /// Half as many against the truth's.
    pub half: Apart,
    /// Twice as many.
    pub twice: Apart,
    /// As many as are called converged.
    pub converged: Apart,
    /// The truth from shaken starts.
    pub shaken: Apart,
    /// Substeps, and their error against the converged motion, mean over quantities.
    pub ladder: Vec<(usize, f64)>,
}

impl Rolled {
    /// An error in shares of that of shaken starts.
    pub fn share(&self, apart: &Apart) -> f64 {
        apart.mean() / self.shaken.mean()
    }

    /// What drives it, in a word.
    pub fn drive(&self) -> &'static str {
        if self.protocol.action == Action::Zero { "passive" } else { "random torques" }
    }
}

/// Rolls a robot out at all numbers of substeps.
///
/// # Errors
/// If it cannot be stepped.
pub(super) fn measure(system: &Arc<System>, scene: &Arc<Scene>, protocol: PassiveConfig, shake: f64) -> Result<Rolled> {
    let solver = |times: f64| Articulated::new(at(system, times));
    let apart = |truth: &mut dyn Solver, other: &mut dyn Solver| -> Result<Apart> {
        let report = passive(system, scene, truth, other, protocol, &mut |_| ())?;
        bounds::figures(&format!("{} in {}: error", system.name, scene.name), &report.error)?;
        let [error, standard_error] = [&report.error, &report.standard_error].map(|figures| summary(system, figures));
        Ok(Apart { error, standard_error, diverged: report.diverged })
    };
    let mut own = Recorder::new(solver(1.0));
    let half = apart(&mut own, &mut solver(0.5))?;
    let own = own.frames;
    let twice = apart(&mut Replay::new(&own), &mut solver(2.0))?;
    let mut shaken = Nudged { solver: solver(1.0), by: shake, seed: protocol.seed.wrapping_add(2), begun: false };
    let shaken = apart(&mut Replay::new(&own), &mut shaken)?;
    let most = ArticulatedConfig { substeps: MOST, contact_substeps: MOST, ..at(system, 1.0) };
    let mut last = Recorder::new(Articulated::new(most));
    let converged = apart(&mut last, &mut solver(1.0))?;
    let mut ladder = Vec::new();
    for times in LADDER {
        let (config, mut replay) = (at(system, times), Replay::new(&last.frames));
        let error = if times == 1.0 { converged.mean() } else { apart(&mut replay, &mut Articulated::new(config))?.mean() };
        ladder.push((taken(system, scene, &config), error));
    }
    let substeps = taken(system, scene, &at(system, 1.0));
    let (robot, scene) = (system.name.clone(), scene.name.clone());
    Ok(Rolled { robot, scene, protocol, substeps, half, twice, converged, shaken, ladder })
}

/// All rollouts.
pub(super) fn table(rows: &[Rolled], shake: f64) -> Table {
    let lines = rows.iter().map(|r| {
        let [half, twice, converged, shaken] = [&r.half, &r.twice, &r.converged, &r.shaken].map(|a| pair(&a.error));
        let share = |apart| digits(r.share(apart));
        let what = [r.robot.clone(), r.scene.clone(), r.drive().into(), r.substeps.to_string()];
        what.into_iter().chain([half, twice, converged, shaken, share(&r.half), share(&r.twice)]).collect()
    });
    let converged = format!("converged (x{MOST})");
    let header =
        ["robot", "scene", "drive", "substeps", "half of them", "twice", &converged, "a shaken start", "half / shaken", "twice / shaken"];
    let protocol = rows.first().map_or_else(String::new, |r| format!("{} rollouts of {} frames", r.protocol.starts, r.protocol.steps));
    Table::new("rollouts", &header).with(lines).noted(&format!(
        "Mean |difference| from the truth over {protocol}: position (m) and orientation (rad) of a floating root, then joints (rad or \
         m), of more than two their mean. Shaken: the truth itself from starts that are N(0, {shake:e}) away in every coordinate (rad, \
         m) and velocity (rad/s, m/s). The last two columns are of means over quantities."
    ))
}

/// How the error falls with substeps.
pub(super) fn ladder(rows: &[Rolled]) -> Table {
    let lines = rows.iter().map(|r| {
        let share = |(n, error): &(usize, f64)| format!("x{n}: {}", digits(error / r.shaken.mean()));
        [r.robot.clone(), r.scene.clone(), r.drive().into()].into_iter().chain(r.ladder.iter().map(share)).collect()
    });
    let header = ["robot", "scene", "drive", "a quarter of the truth's substeps", "half", "once", "twice", "four times"];
    Table::new("ladder", &header).with(lines).noted(&format!(
        "So many substeps against x{MOST}: mean over quantities of the mean |difference|, in shares of that of shaken starts. Below 1 \
         a start known to that accuracy matters more than the step."
    ))
}

/// A solver whose first frame begins a little beside where it is told to.
struct Nudged<S> {
    solver: S,
    by: f64,
    seed: u64,
    begun: bool,
}

impl<S: Solver> Solver for Nudged<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        if !self.begun {
            self.begun = true;
            let system = batch.system.clone();
            (0..batch.len()).for_each(|env| nudge(&system, batch.state_mut(env), self.by, &mut stream(self.seed, env as u64)));
        }
        self.solver.step(batch, torques)
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}

/// Moves and turns a state at random; a root's velocities are those of its own origin.
fn nudge(system: &System, state: &mut [f64], by: f64, rng: &mut impl Rng) {
    let robot = &system.robot;
    let (q, qd) = state.split_at_mut(robot.nq());
    to_local(robot, q, qd);
    let mut noise = || by * normal(rng);
    if robot.floating() {
        let place = vector(q) + nalgebra::Vector3::from_fn(|_, _| noise());
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::from_fn(|_, _| noise()));
        q[..3].copy_from_slice(place.as_slice());
        let turned = turn * quaternion(&q[3..7]);
        write_quaternion(&mut q[3..7], &turned);
    }
    q[robot.root_coords()..].iter_mut().chain(qd.iter_mut()).for_each(|x| *x += noise());
    to_world(robot, q, qd);
}
