//! A model of a subject before it has learned anything, and training on single frames: the paper's way with measured motion.

use std::sync::Arc;

use nerd_model::base::Base;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::transformer::{Positions, TransformerConfig, Weights};
use nerd_sim::calibrate::Subject;
use nerd_sim::dataset::Recording;
use nerd_sim::prelude::*;

use super::UnrollConfig;
use super::chosen::{Chosen, Worth};
use crate::device::Device;
use crate::error::{Error, Result};
use crate::learner::{LearnerConfig, LearnerState, Optimizer};
use crate::prepare::{moments, normalize, tokens};
use crate::run::engine::engine;
use crate::schedule::Schedule;

/// A model with a small network, before it has learned anything.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SmallModel {
    /// What predictions are added to.
    pub base: Base,
    /// Width.
    pub embedding: usize,
    /// Layers.
    pub layers: usize,
    /// Tokens that a token sees.
    pub history: usize,
    /// Frames of a rollout in training.
    pub sequence: usize,
    /// What a prediction of 1 means, as a share of a single frame's deviation from the base: most of that may be noise.
    pub scale: f64,
}

impl SmallModel {
    /// A model that says nothing yet: its motion is its base's. Its normaliser is of `recording`.
    ///
    /// # Errors
    /// If the base cannot be stepped, or there can be no such network.
    pub fn silent(&self, subject: &Subject, truth: &str, recording: &Recording, seed: u64) -> Result<Model> {
        let windows = tokens(&subject.system, recording, self.sequence, self.base)?;
        let mut normalizer = moments(&windows);
        normalizer.outputs.epsilon = 1e-12;
        normalizer.outputs.variance.iter_mut().for_each(|v| *v *= self.scale * self.scale);
        // Nothing said is no change.
        normalizer.outputs.mean.fill(0.0);
        if subject.system.robot.floating() {
            normalizer.outputs.mean[6] = 1.0;
        }
        let network = TransformerConfig {
            layers: self.layers,
            heads: (self.embedding / 16).max(1),
            block: self.sequence,
            history: self.history,
            positions: Positions::Rotary,
            ..TransformerConfig::paper(windows.inputs, windows.outputs, self.embedding)
        };
        network.check().map_err(Error::Refused)?;
        let mut weights = Weights::init(network, seed);
        silence(&mut weights);
        let config = ModelConfig {
            robot: subject.system.name.clone(),
            robot_sha256: subject.system.robot_sha256(),
            truth: truth.into(),
            base: self.base,
            view: Default::default(),
            turns: Default::default(),
            network,
            model_sha256: String::new(),
            data_sha256: String::new(),
            transitions: recording.trajectories * recording.frames,
            updates: 0,
            batch: 0,
            provenance: Default::default(),
        };
        Ok(Model { config, normalizer, weights })
    }
}

/// Trains a model on the single frames of a recording, on this device; its best weights by `worth`, those at the start among them.
///
/// # Errors
/// What learner and `worth` say.
pub fn single(
    model: &Model,
    subject: &Subject,
    recording: &Recording,
    (config, device): (UnrollConfig, Device),
    worth: &Worth,
    progress: &mut dyn FnMut(u64, f64),
) -> Result<(Model, f64)> {
    config.check()?;
    let mut windows = tokens(&subject.system, recording, model.config.network.sequence(), model.config.form())?;
    normalize(&mut windows, &model.normalizer);
    let windows = Arc::new(windows);
    let settings =
        LearnerConfig { batch: config.batch, clip: 1.0, average: 0.99, seed: config.seed, huber: Some(1.0), optimizer: Optimizer::Muon };
    let schedule = Schedule { start: config.rate, end: 0.0, ..Schedule::default() };
    let mut learner =
        engine(device, false, settings, LearnerState::new(model.weights.clone()), [windows.clone(), windows], &Arc::default())?;
    let mut chosen = Chosen::new(model, worth)?;
    for step in 0..config.updates {
        learner.update(schedule.rate(step, config.updates) as f32)?;
        chosen.look(step + 1, &config, &mut *learner)?;
        progress(step + 1, chosen.worth);
    }
    Ok(chosen.best())
}

/// Makes a network say nothing: zeros in its last layer.
pub fn silence(weights: &mut Weights) {
    let last = weights.config.outputs * (weights.config.head + 1);
    let n = weights.flat.len();
    weights.flat[n - last..].fill(0.0);
}

/// A model as a maker of solvers.
pub fn solver(model: &Model, system: &Arc<System>) -> impl Fn() -> Box<dyn Solver> + Sync + use<> {
    let (model, system) = (model.clone(), system.clone());
    move || Box::new(Neural::on_cpu(model.clone(), &system))
}
