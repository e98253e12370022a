//! What can be learned beyond a calibration: networks on the calibrated solver, or in the place of its contact.

use nerd_model::folder::Model;
use nerd_sim::calibrate::Distance;
use nerd_sim::log::Log;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::learning::Learning;
use super::split::{Parts, Scored};
use super::{Calibrated, Calibration};
use crate::device::Device;
use crate::error::{Result, refuse};
use crate::report::table::digits;

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
    /// By split, the mean distance from rollouts of the calibrated solver: what was learned of it, and what of that was forgotten.
    pub simulated: Vec<Distance>,
}

/// How long networks are trained, where, and how large they are.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Width.
    pub embedding: usize,
    /// Layers.
    pub layers: usize,
    /// Frames of a rollout in training.
    pub sequence: usize,
    /// Frames that the network sees.
    pub history: usize,
    /// Updates over many frames.
    pub updates: u64,
    /// Updates on single frames.
    pub singles: u64,
    /// Where those are made.
    pub device: Device,
    /// Seed of weights and draws.
    pub seed: u64,
}

impl Calibration {
    /// Refuses what nothing can be learned by, before anything is fitted.
    pub(super) fn learnable(&self, log: &Log, parts: &[Parts]) -> Result<()> {
        if let Some(other) = self.learn.iter().find(|way| WAYS.iter().all(|known| known.0 != *way)) {
            refuse!("--learn {other}: known are {}", WAYS.map(|w| w.0).join(", "));
        }
        let (Some(solver), false) = (self.solvers.first(), self.learn.is_empty()) else { return Ok(()) };
        if solver != "articulated" {
            refuse!("--learn learns beyond `articulated`: name it first among --solvers");
        }
        let (subject, parameters) = self.subject(log, solver)?;
        let values: Vec<f64> = parameters.iter().map(|p| p.nominal).collect();
        parts.iter().try_for_each(|part| {
            let effort = self.effort(self.seed);
            Learning { log, subject: &subject, parameters: &parameters, values: &values, parts: part, effort }.check(&self.learn)
        })
    }

    /// How long networks are trained, where, and how large they are.
    pub(super) fn effort(&self, seed: u64) -> Effort {
        let Self { embedding, layers, history, updates, singles, device, .. } = *self;
        let sequence = self.sequence.unwrap_or(self.frames - 1);
        Effort { embedding, layers, sequence, history, updates, singles, device, seed }
    }

    /// What is learned beyond the first solver's calibration, and the models of the first split.
    pub(super) fn learned(&self, log: &Log, fitted: &[Calibrated], parts: &[Parts]) -> Result<(Vec<Learned>, Vec<Model>)> {
        let (Some(first), Some(solver), false) = (fitted.first(), self.solvers.first(), self.learn.is_empty()) else {
            return Ok(Default::default());
        };
        let (subject, parameters) = self.subject(log, solver)?;
        let splits: Vec<_> = first.splits.iter().zip(parts).zip(self.seed..).collect();
        let one = |((split, parts), seed): ((&super::Split, &Parts), u64)| {
            let (values, effort) = (&split.fit.values[..], self.effort(seed));
            let calibrated = subject.with(&parameters, values)?;
            let learning = Learning { log, subject: &calibrated, parameters: &parameters, values, parts, effort };
            let models = learning.learn(&self.learn)?;
            let judged = models.iter().map(|model| learning.judged(model, seed)).collect::<Result<Vec<_>>>()?;
            for (way, (after, ..)) in self.learn.iter().zip(&judged) {
                eprintln!("split {}, {way}: {}", seed - self.seed, after.words());
            }
            Ok((models, judged))
        };
        // One split alone shows how far it is; several go side by side.
        let done = match &splits[..] {
            [only] => vec![one(*only)?],
            _ => splits.into_par_iter().map(one).collect::<Result<Vec<_>>>()?,
        };
        let row = |(k, way): (usize, &String)| Learned {
            way: way.clone(),
            after: done.iter().map(|(_, judged)| judged[k].0.clone()).collect(),
            whole: done.iter().map(|(_, judged)| judged[k].1.clone()).collect(),
            simulated: done.iter().map(|(_, judged)| judged[k].2).collect(),
        };
        let rows = self.learn.iter().enumerate().map(row).collect();
        Ok((rows, done.into_iter().next().unwrap_or_default().0))
    }
}

impl Scored {
    /// Its means, in words.
    pub fn words(&self) -> String {
        let Distance { position, rotation, joints, .. } = self.mean;
        let root = format!("{} m / {} rad", digits(position), digits(rotation));
        match (position > 0.0 || rotation > 0.0, joints > 0.0) {
            (true, true) => format!("{root} / joints {}", digits(joints)),
            (false, true) => format!("joints {}", digits(joints)),
            _ => root,
        }
    }
}
