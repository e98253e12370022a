//! A model is a folder: `config.json`, `normalizer.json`, `model.safetensors` and a card, `README.md`.
//!
//! Models are identified by content. `config.json` holds a hash of the robot that was learned and one of all that decides predictions:
//! shape of the network, form, normaliser, weights. So another robot of the same name is refused, and so is a file that was changed,
//! truncated or copied from another folder.

mod config;
mod error;
mod stamp;

use std::collections::HashMap;
use std::path::Path;

use nerd_sim::system::System;
use sha2::{Digest, Sha256};

pub use config::ModelConfig;
pub use error::ModelError;
pub use stamp::{models_in, stamp};

use crate::normalizer::{Moments, Normalizer};
use crate::transformer::{Storage, Weights};
use error::{file, read_json, wrong};

/// A trained network with its normaliser and its provenance.
#[derive(Clone, Debug)]
pub struct Model {
    /// What it is.
    pub config: ModelConfig,
    /// Shift and scale of its inputs and outputs.
    pub normalizer: Normalizer,
    /// Its parameters.
    pub weights: Weights,
}

impl Model {
    /// Loads the model of `system` from a folder; refuses one of another robot, or of another truth if one is named, and one
    /// whose files are not those it was written with.
    ///
    /// # Errors
    /// One line that says which file, what is wrong, and both sides where two do not agree.
    pub fn load(folder: &Path, system: &System, truth: Option<&str>) -> Result<Self, ModelError> {
        let model = Self::read(folder, system, truth)?;
        let ModelConfig { robot, robot_sha256, model_sha256, .. } = &model.config;
        for (key, hash) in [("robot_sha256", robot_sha256), ("model_sha256", model_sha256)] {
            if hash.is_empty() {
                return Err(ModelError::NoStamp { path: folder.into(), key });
            }
        }
        let (path, at_hand, read) = (folder.into(), system.robot_sha256(), model.sha256());
        if *robot_sha256 != at_hand {
            return Err(ModelError::Robot { path, robot: robot.clone(), found: robot_sha256.clone(), wanted: at_hand });
        }
        if *model_sha256 != read {
            return Err(ModelError::Changed { path, found: read, wanted: model_sha256.clone() });
        }
        Ok(model)
    }

    /// The same without a look at the hashes: for [`Model::stamp`].
    ///
    /// # Errors
    /// As [`Model::load`].
    pub fn read(folder: &Path, system: &System, truth: Option<&str>) -> Result<Self, ModelError> {
        let config = ModelConfig::read(folder)?;
        config.check(folder, system, truth)?;
        let path = folder.join("normalizer.json");
        let normalizer: Normalizer = read_json(&path)?;
        let (inputs, outputs) = (config.network.inputs, config.network.outputs);
        for (name, moments, width) in [("inputs", &normalizer.inputs, inputs), ("outputs", &normalizer.outputs, outputs)] {
            check(moments, width).map_err(|reason| wrong(&path, format!("{name}: {reason}")))?;
        }
        let path = folder.join("model.safetensors");
        let unfit = |e: crate::transformer::WeightsError| wrong(&path, e.to_string());
        // A file that cannot be the network's is not even read.
        Weights::check_size(&config.network, std::fs::metadata(&path).map_err(file(&path))?.len()).map_err(unfit)?;
        let bytes = std::fs::read(&path).map_err(file(&path))?;
        let weights = Weights::from_bytes(config.network, &bytes).map_err(unfit)?;
        Ok(Self { config, normalizer, weights })
    }

    /// SHA-256 of all that decides its predictions, as lower-case hex: truth, form, shape of the network, moments, weights.
    pub fn sha256(&self) -> String {
        let ModelConfig { truth, base, view, network, .. } = &self.config;
        let shape = serde_json::to_string(&(truth, base, view, network)).unwrap_or_default();
        let mut hash = Sha256::new();
        hash.update((shape.len() as u64).to_le_bytes());
        hash.update(shape);
        let Normalizer { inputs, outputs } = &self.normalizer;
        for column in [&inputs.mean, &inputs.variance, &outputs.mean, &outputs.variance] {
            hash.update((column.len() as u64).to_le_bytes());
            column.iter().for_each(|x| hash.update(x.to_le_bytes()));
        }
        [inputs, outputs].iter().for_each(|moments| hash.update(moments.epsilon.to_le_bytes()));
        // In pieces, since a hash that is fed four bytes at a time takes most of a second over a large network.
        for piece in self.weights.flat.chunks(4096) {
            hash.update(piece.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>());
        }
        hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Accepts its content as learned from `system`: rewrites both hashes of its configuration.
    pub fn stamp(&mut self, system: &System) {
        self.config.robot_sha256 = system.robot_sha256();
        self.config.model_sha256 = self.sha256();
    }

    /// Writes the folder, `config.json` last; `card` becomes its `README.md`. The configuration's `model_sha256` is made here.
    ///
    /// # Errors
    /// If it cannot be written, or a weight is not a number as it would be stored.
    pub fn save(&self, folder: &Path, card: &str, storage: Storage) -> Result<(), ModelError> {
        let unfit = |e: crate::transformer::WeightsError| wrong(&folder.join("model.safetensors"), e.to_string());
        let bytes = self.weights.to_bytes(HashMap::from([("robot".into(), self.config.robot.clone())]), storage).map_err(unfit)?;
        let json = |text: serde_json::Result<String>| text.map(|s| (s + "\n").into_bytes()).map_err(|e| wrong(folder, e.to_string()));
        let moments = json(serde_json::to_string_pretty(&self.normalizer))?;
        // As they will be read: storage may round, and serde_json reads some numbers a last bit beside what was written.
        let normalizer = serde_json::from_slice(&moments).map_err(|e| wrong(folder, e.to_string()))?;
        let weights = Weights::from_bytes(self.config.network, &bytes).map_err(unfit)?;
        let stored = Self { config: self.config.clone(), normalizer, weights };
        let config = ModelConfig { model_sha256: stored.sha256(), ..stored.config };
        let files = [
            ("normalizer.json", moments),
            ("README.md", card.into()),
            ("model.safetensors", bytes),
            ("config.json", json(serde_json::to_string_pretty(&config))?),
        ];
        files.iter().try_for_each(|(name, bytes)| {
            let path = folder.join(name);
            nerd_sim::files::write(&path, bytes).map_err(file(&path))
        })
    }
}

/// Says what of moments cannot be.
fn check(moments: &Moments, width: usize) -> Result<(), String> {
    let Moments { mean, variance, epsilon } = moments;
    if !(1e-30..=1.0).contains(epsilon) {
        return Err(format!("`epsilon` is {epsilon}, it must be 1e-30 to 1"));
    }
    for (name, column, least) in [("mean", mean, f64::NEG_INFINITY), ("variance", variance, 0.0)] {
        if column.len() != width {
            return Err(format!("{} numbers of `{name}`, the network has {width}", column.len()));
        }
        if let Some(k) = column.iter().position(|x| !x.is_finite() || *x < least) {
            return Err(format!("`{name}` {k} is {}: a finite number is needed, of a variance not below 0", column[k]));
        }
    }
    Ok(())
}
