//! What can be learned beyond a calibration: networks on the calibrated solver, or in the place of its contact.

use nerd_sim::calibrate::Distance;
use nerd_sim::log::Log;
use serde::{Deserialize, Serialize};

use super::pupil::Pupil;
use super::split::{Parts, Scored};
use super::{Calibrated, Calibration};
use crate::error::{Result, refuse};

/// Ways of learning, by the word that the command takes.
pub const WAYS: [(&str, &str); 6] = [
    ("residual", "network on the calibrated solver, many frames"),
    ("residual-single", "network on the calibrated solver, single frames"),
    ("pretrained", "NeRD, simulation alone"),
    ("paper", "NeRD, simulation, then single frames (the paper's way)"),
    ("fine-tuned", "NeRD, simulation, then many frames"),
    ("real-only", "NeRD, no simulation, single then many frames"),
];

/// One way of learning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Learned {
    /// Its word.
    pub way: String,
    /// On the judged part of every split.
    pub after: Vec<Scored>,
    /// Whole trajectories.
    pub whole: Vec<Scored>,
    /// In simulation, by split: mean distance from rollouts of the calibrated solver, of pretrained models.
    pub simulated: Vec<Distance>,
}

/// How long networks are trained, and how large they are.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Width.
    pub embedding: usize,
    /// Layers.
    pub layers: usize,
    /// Frames of a rollout in training.
    pub sequence: usize,
    /// Updates over many frames.
    pub updates: u64,
    /// Updates on single frames.
    pub singles: u64,
    /// Seed of weights and draws.
    pub seed: u64,
}

impl Calibration {
    /// Refuses what nothing can be learned by, before anything is fitted.
    pub(super) fn learnable(&self) -> Result<()> {
        if let Some(other) = self.learn.iter().find(|way| WAYS.iter().all(|known| known.0 != *way)) {
            refuse!("--learn {other}: known are {}", WAYS.map(|w| w.0).join(", "));
        }
        if !self.learn.is_empty() && self.solvers.first().is_none_or(|first| first != "articulated") {
            refuse!("--learn learns beyond `articulated`: name it first among --solvers");
        }
        Ok(())
    }

    /// How long networks are trained, and how large they are.
    pub(super) fn effort(&self, seed: u64) -> Effort {
        let Self { embedding, layers, sequence, updates, singles, .. } = *self;
        Effort { embedding, layers, sequence, updates, singles, seed }
    }

    /// What is learned beyond the first solver's calibration.
    pub(super) fn learned(&self, log: &Log, fitted: &[Calibrated], parts: &[Parts]) -> Result<Vec<Learned>> {
        let new = |way: &String| Learned { way: way.clone(), after: Vec::new(), whole: Vec::new(), simulated: Vec::new() };
        let mut all: Vec<Learned> = self.learn.iter().map(new).collect();
        let (Some(first), Some(solver)) = (fitted.first().filter(|_| !all.is_empty()), self.solvers.first()) else { return Ok(all) };
        let (subject, parameters) = self.subject(log, solver)?;
        for (k, (split, parts)) in first.splits.iter().zip(parts).enumerate() {
            let seed = self.seed + k as u64;
            let effort = self.effort(seed);
            let calibrated = subject.with(&parameters, &split.fit.values)?;
            let pupil = Pupil { log, subject: &calibrated, parameters: &parameters, values: &split.fit.values, parts, effort };
            for (row, model) in all.iter_mut().zip(pupil.learn(&self.learn)?) {
                let (after, whole, simulated) = pupil.judged(&model, seed)?;
                eprintln!("split {k}, {}: {:.5} m, {:.4} rad", row.way, after.mean.position, after.mean.rotation);
                row.after.push(after);
                row.whole.push(whole);
                row.simulated.push(simulated);
            }
        }
        Ok(all)
    }
}
