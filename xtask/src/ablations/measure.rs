//! One model's errors: passive motion where the robot's data lies, and moved away from there.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use nalgebra::Vector3;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive, summary};
use serde::{Deserialize, Serialize};

use crate::common::Device;
use crate::solvers::neural;
use crate::stability::shift;
use crate::train::{TRUTH, truth};

/// Frames of a rollout, as in the paper's first test case.
pub const STEPS: usize = 100;

/// How far (m) a floating robot is moved: twice the half-width of the box in which the Ant's data starts.
pub const AWAY: f64 = 20.0;

/// Errors of one trained model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    /// Seed of data, weights and windows.
    pub seed: u64,
    /// Mean |difference| over steps and starts by quantity (rad or m; [`summary`]).
    pub error: Vec<f64>,
    /// Standard error of that mean over starts, by quantity.
    pub standard_error: Vec<f64>,
    /// Mean |difference| after one frame, averaged over the quantities: what one prediction is wrong by.
    pub one_frame: f64,
    /// Rollouts that diverged.
    pub diverged: usize,
    /// The same error with the robot moved [`AWAY`]; nothing where the robot's base is fixed.
    pub away: Option<Vec<f64>>,
    /// The floor that repeats the start, by quantity.
    pub hold: Vec<f64>,
}

/// Rolls a model out from `starts` starts.
pub fn measure(folder: &Path, system: &Arc<System>, starts: usize, seed: u64, device: Device) -> Result<Measured> {
    let scene = system.scene(system.usual_scenes().first().copied().unwrap_or("free"))?;
    let config = PassiveConfig { starts, steps: STEPS, seed: 500, action: Action::Zero };
    let roll = |solver: &mut dyn Solver| passive(system, &scene, &mut *truth(system), solver, config, &mut |_| ());
    let model = || neural(folder, system, Some(TRUTH), device, starts);
    let here = roll(&mut model()?)?;
    let away = match system.robot.floating() {
        true => Some(summary(system, &roll(&mut Away(Box::new(model()?)))?.error)),
        false => None,
    };
    Ok(Measured {
        seed,
        error: summary(system, &here.error),
        standard_error: summary(system, &here.standard_error),
        one_frame: here.curve.first().copied().unwrap_or(0.0),
        diverged: here.diverged,
        away,
        hold: summary(system, &here.hold),
    })
}

/// A solver that is told all robots stand [`AWAY`] in x. On a level plane a robot's motion is the same there.
struct Away(Box<dyn Solver>);

impl Solver for Away {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let by = Vector3::new(AWAY, 0.0, 0.0);
        shift(batch, &by);
        let done = self.0.step(batch, torques);
        shift(batch, &-by);
        done
    }

    fn reset(&mut self, env: usize) {
        self.0.reset(env);
    }
}
