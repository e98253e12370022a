//! A model is a folder: `config.json`, `normalizer.json`, `model.safetensors` and a card, `README.md`.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nerd_sim::system::System;
use serde::{Deserialize, Serialize};

use crate::base::Base;
use crate::features::Features;
use crate::form::{Form, View};
use crate::normalizer::Normalizer;
use crate::transformer::{Storage, TransformerConfig, Weights, WeightsError};

/// Why a model cannot be loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file system said no.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: std::io::Error,
    },
    /// Not what the file should hold.
    #[error("{path}: {reason}", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// The model was made for something else.
    #[error("{path}: this model learned {what} `{found}`, not `{wanted}`", path = path.display())]
    Other {
        /// The folder.
        path: PathBuf,
        /// `robot` or `truth`.
        what: &'static str,
        /// What it learned.
        found: String,
        /// What was asked for.
        wanted: String,
    },
}

/// What was learned, from what, how; `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Robot.
    pub robot: String,
    /// The solver and preset that is the truth, for example `articulated paper coulomb`.
    pub truth: String,
    /// What its predictions are added to.
    #[serde(default)]
    pub base: Base,
    /// Where its tokens are seen from.
    #[serde(default, skip_serializing_if = "own")]
    pub view: View,
    /// Shape of the network.
    pub network: TransformerConfig,
    /// SHA-256 of the training data.
    pub data_sha256: String,
    /// Transitions of the training data.
    pub transitions: usize,
    /// Optimiser updates.
    pub updates: u64,
    /// Windows in an update.
    pub batch: usize,
    /// Everything else worth knowing: command, machine, commit, seed, minutes.
    #[serde(default)]
    pub provenance: HashMap<String, String>,
}

impl ModelConfig {
    /// That of a model's folder.
    pub fn read(folder: &Path) -> Result<Self, ModelError> {
        read_json(&folder.join("config.json"))
    }

    /// In which form it sees and predicts motion.
    pub fn form(&self) -> Form {
        Form { base: self.base, view: self.view }
    }
}

/// The usual view stands in no file.
fn own(view: &View) -> bool {
    *view == View::Own
}

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
    /// Loads the model of `system` from a folder; refuses one of another robot, or of another truth if one is named.
    pub fn load(folder: &Path, system: &System, truth: Option<&str>) -> Result<Self, ModelError> {
        let config = ModelConfig::read(folder)?;
        let other =
            |what, found: &str, wanted: &str| ModelError::Other { path: folder.into(), what, found: found.into(), wanted: wanted.into() };
        if config.robot != system.name {
            return Err(other("robot", &config.robot, &system.name));
        }
        if let Some(wanted) = truth.filter(|t| *t != config.truth) {
            return Err(other("truth", &config.truth, wanted));
        }
        let normalizer: Normalizer = read_json(&folder.join("normalizer.json"))?;
        let path = folder.join("model.safetensors");
        let wrong = |reason: String| ModelError::Format { path: path.clone(), reason };
        let (inputs, outputs) = (Features::inputs(system, config.form()), Features::outputs(system));
        let network = config.network;
        if (network.inputs, network.outputs) != (inputs, outputs) {
            return Err(wrong(format!(
                "maps {} to {} numbers; robot `{}` needs {inputs} to {outputs}",
                network.inputs, network.outputs, system.name
            )));
        }
        let lengths =
            [&normalizer.inputs.mean, &normalizer.inputs.variance, &normalizer.outputs.mean, &normalizer.outputs.variance].map(Vec::len);
        if lengths != [inputs, inputs, outputs, outputs] {
            return Err(wrong(format!("normalizer.json has {lengths:?} numbers, expected {:?}", [inputs, inputs, outputs, outputs])));
        }
        let bytes = std::fs::read(&path).map_err(|source| ModelError::File { path: path.clone(), source })?;
        let weights = Weights::from_bytes(network, &bytes).map_err(|e: WeightsError| wrong(e.to_string()))?;
        Ok(Self { config, normalizer, weights })
    }

    /// Writes the folder, each file whole or not at all; `card` becomes its `README.md`.
    pub fn save(&self, folder: &Path, card: &str, storage: Storage) -> Result<(), ModelError> {
        let format = |e: String| ModelError::Format { path: folder.into(), reason: e };
        let json = |x: serde_json::Result<String>| x.map(|s| s + "\n").map_err(|e| format(e.to_string()));
        let bytes = self
            .weights
            .to_bytes(HashMap::from([("robot".into(), self.config.robot.clone())]), storage)
            .map_err(|e| format(e.to_string()))?;
        write(&folder.join("config.json"), json(serde_json::to_string_pretty(&self.config))?.as_bytes())?;
        write(&folder.join("normalizer.json"), json(serde_json::to_string_pretty(&self.normalizer))?.as_bytes())?;
        write(&folder.join("README.md"), card.as_bytes())?;
        write(&folder.join("model.safetensors"), &bytes)
    }
}

fn read_json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, ModelError> {
    let text = std::fs::read_to_string(path).map_err(|source| ModelError::File { path: path.into(), source })?;
    serde_json::from_str(&text).map_err(|e| ModelError::Format { path: path.into(), reason: e.to_string() })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), ModelError> {
    nerd_sim::files::write(path, bytes).map_err(|source| ModelError::File { path: path.into(), source })
}
