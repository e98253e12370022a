//! One model's errors: passive motion where the robot's data lies, and moved away from there.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use nalgebra::Vector3;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive, summary};
use serde::{Deserialize, Serialize};

use crate::common::Device;
use crate::solvers::neural;
use crate::stability::shift;
use crate::truth::Truth;

/// Frames of a rollout: those of the paper's first test case; of the Ant, which loses the ground of knowing more than nothing
/// sooner after so short a training, a third of a second.
pub fn steps(robot: &str) -> usize {
    if robot == "ant" { 20 } else { 100 }
}

/// How far (m) a floating robot is moved: twice the half-width of the box in which the Ant's data starts.
pub const AWAY: f64 = 20.0;

/// Errors of one trained model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    /// Seed of data, weights and windows.
    pub seed: u64,
    /// Validation loss after the last update, normalised MSE: comparable between variants of the same targets.
    pub loss: f64,
    /// Training loss of the third quarter of the run over that of the last.
    pub falling: f64,
    /// Least and largest scale of the inputs that are no constants; of a variant without input normalisation 1 and 1.
    pub scales: [f64; 2],
    /// Mean |difference| over steps and starts by quantity (rad or m; [`summary`]).
    pub error: Vec<f64>,
    /// Standard error of that mean over starts, by quantity.
    pub standard_error: Vec<f64>,
    /// Mean |difference| after one frame, averaged over the joints and the root's place and orientation: what the first
    /// prediction, from a window of one token, is wrong by.
    pub one_frame: f64,
    /// Rollouts that diverged.
    pub diverged: usize,
    /// `error` and `one_frame` with the robot moved [`AWAY`]; nothing where the robot's base is fixed.
    pub away: Option<(Vec<f64>, f64)>,
    /// The floor that repeats the start, by quantity.
    pub hold: Vec<f64>,
}

/// What a run's record says: validation loss, and [`Measured::falling`].
fn record(run: &Path) -> Result<(f64, f64)> {
    let path = run.join("metrics.jsonl");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let lines: Vec<serde_json::Value> =
        text.lines().map(serde_json::from_str).collect::<Result<_, _>>().with_context(|| path.display().to_string())?;
    let losses = |kind: &str| lines.iter().filter(|l| l["kind"] == kind).filter_map(|l| l["loss"].as_f64()).collect::<Vec<f64>>();
    let (train, validation) = (losses("train"), losses("validation").pop());
    let quarter = |k: usize| {
        let part = &train[k * train.len() / 4..(k + 1) * train.len() / 4];
        part.iter().sum::<f64>() / part.len() as f64
    };
    Ok((validation.unwrap_or(f64::NAN), quarter(2) / quarter(3)))
}

/// Rolls the model of the folder of a run out from `starts` starts.
pub fn measure(run: &Path, system: &Arc<System>, starts: usize, seed: u64, device: Device) -> Result<Measured> {
    let (loss, falling) = record(run)?;
    let scene = system.scene(system.usual_scenes().first().copied().unwrap_or("free"))?;
    let config = PassiveConfig { starts, steps: steps(&system.name), seed: 500, action: Action::Zero };
    let roll = |solver: &mut dyn Solver| passive(system, &scene, &mut *Truth::Articulated.solver(system), solver, config, &mut |_| ());
    let model = || neural(&run.join("model"), system, Some(&Truth::Articulated.name()), device, starts);
    let mut learned = model()?;
    let scales = learned.model().normalizer.inputs.scale();
    let scales = scales.into_iter().filter(|s| *s > 0.01).fold([f64::MAX, 0.0], |[a, b], s| [a.min(s), f64::max(b, s)]);
    let here = roll(&mut learned)?;
    let first = |report: &PassiveReport| report.curve.first().copied().unwrap_or(0.0);
    let away = match system.robot.floating() {
        true => {
            let there = roll(&mut Away(Box::new(model()?)))?;
            Some((summary(system, &there.error), first(&there)))
        }
        false => None,
    };
    Ok(Measured {
        seed,
        loss,
        falling,
        scales,
        error: summary(system, &here.error),
        standard_error: summary(system, &here.standard_error),
        one_frame: first(&here),
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
