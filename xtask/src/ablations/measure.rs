//! One model's errors: passive motion, and the rewards of policies that run in it.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive, summary};
use serde::{Deserialize, Serialize};

use super::runners::Runners;
use crate::common::Device;

use nerd_sim::truth::Truth;

/// Frames of a rollout: those of the paper's first test case; of the Ant, which loses the ground of knowing more than nothing
/// sooner after so short a training, a third of a second.
pub fn steps(robot: &str) -> usize {
    if robot == "ant" { 20 } else { 100 }
}

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
    /// Of running policies, |reward in the model - in the truth| over the latter, mean over policies; the Ant's alone.
    pub gap: Option<f64>,
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
    let validation = validation.with_context(|| format!("{}: no validation loss; remove the run and train it anew", path.display()))?;
    let falling = quarter(2) / quarter(3);
    crate::numbers::figures(&format!("{}: fall of the training loss", path.display()), &[falling])?;
    Ok((validation, falling))
}

/// Rolls the model of the folder of a run out from `starts` starts, and lets policies run in it.
pub fn measure(
    run: &Path,
    system: &Arc<System>,
    (starts, seed): (usize, u64),
    runners: Option<&Runners>,
    device: Device,
) -> Result<Measured> {
    let (loss, falling) = record(run)?;
    let scene = system.scene(system.usual_scenes().first().copied().unwrap_or("free"))?;
    let config = PassiveConfig { starts, steps: steps(&system.name), seed: 500, action: Action::Zero };
    let folder = run.join("model");
    let mut learned = device.neural(&folder, system, Some(&Truth::Articulated.name()), starts)?;
    let scales = learned.model().normalizer.inputs.scale();
    let scales = scales.into_iter().filter(|s| *s > 0.01).fold([f64::MAX, 0.0], |[a, b], s| [a.min(s), f64::max(b, s)]);
    let here = passive(system, &scene, &mut *Truth::Articulated.solver(system), &mut learned, config, &mut |_| ())?;
    let gap = runners.filter(|_| system.name == "ant").map(|r| r.gap(&folder, device)).transpose()?;
    Ok(Measured {
        seed,
        loss,
        falling,
        scales,
        error: summary(system, &here.error),
        standard_error: summary(system, &here.standard_error),
        one_frame: here.curve.first().copied().unwrap_or(0.0),
        diverged: here.diverged,
        gap,
        hold: summary(system, &here.hold),
    })
}
