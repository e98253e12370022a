//! `config.json`: the robot, the data and the training of a model. It is written last, so a folder that has it is complete. Also the errors
//! of loading and saving a model.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nerd_sim::files::read_text;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::chain::{self, Chain, NoChain};
use crate::form::{Form, View};
use crate::prelude::*;
use crate::transformer::{Architecture, TransformerConfig};
use crate::{base::Base, features::Features, program::config::usual};

/// Robot, data and training of a model; `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Name of the robot.
    pub robot: String,
    /// Hash of the parts of the robot that determine its motion ([`System::robot_sha256`]).
    pub robot_sha256: String,
    /// The solver and preset whose motion it learned, for example `articulated accurate`.
    pub truth: String,
    /// The base to which its predictions are added.
    #[serde(default)]
    pub base: Base,
    /// Content of its tokens.
    #[serde(default, skip_serializing_if = "usual")]
    pub view: View,
    /// Whether its tokens end with the drawn parameters of their robot.
    #[serde(default, skip_serializing_if = "usual")]
    pub told: bool,
    /// Shape of the network.
    pub network: TransformerConfig,
    /// Hash of all that decides its predictions ([`super::Model::sha256`]); [`super::Model::save`] writes it.
    pub model_sha256: String,
    /// SHA-256 of the training data.
    pub data_sha256: String,
    /// Transitions of the training data.
    pub transitions: usize,
    /// Optimiser updates.
    pub updates: u64,
    /// Windows in an update.
    pub batch: usize,
    /// Everything else worth recording: command, machine, commit, seed, minutes.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

impl ModelConfig {
    /// Reads the configuration of a model's folder. Its network is checked to be possible, whatever the other files hold.
    pub fn read(folder: &Path) -> Result<Self, ModelError> {
        let path = folder.join("config.json");
        let config: Self = read_json(&path)?;
        config.network.check().map_err(|reason| wrong(&path, format!("network: {reason}")))?;
        Ok(config)
    }

    /// The solver whose motion the model in a folder learned.
    pub fn truth_of(folder: &Path) -> Result<Truth, ModelError> {
        Truth::named(&Self::read(folder)?.truth).map_err(|e| wrong(&folder.join("config.json"), e))
    }

    /// Form of its tokens and predictions.
    pub fn form(&self) -> Form {
        Form { base: self.base, view: self.view, told: self.told }
    }

    /// Refuses a model whose robot's name, or truth if one is given, differs, or whose widths do not fit the robot.
    pub(super) fn check(&self, folder: &Path, system: &System, truth: Option<&str>) -> Result<(), ModelError> {
        for (what, found, wanted) in [("robot", &self.robot, &*system.name), ("truth", &self.truth, truth.unwrap_or(&self.truth))] {
            if found != wanted {
                return Err(wrong(folder, format!("this model learned {what} `{found}`, not `{wanted}`")));
            }
        }
        let path = folder.join("config.json");
        let wanted = match self.network.architecture {
            Architecture::Chain => {
                let rods = Chain::of(system).map_err(|e| wrong(&path, e))?.rods;
                if self.network.block != rods {
                    let block = self.network.block;
                    return Err(wrong(&path, format!("`block` is {block}, robot `{}` has {rods} rods", system.name)));
                }
                (chain::INPUTS, chain::OUTPUTS)
            }
            _ => (Features::inputs(system, self.form()), Features::outputs(system)),
        };
        let found = (self.network.inputs, self.network.outputs);
        if found != wanted {
            let (of, needs) = (format!("{} to {}", found.0, found.1), format!("{} to {}", wanted.0, wanted.1));
            return Err(wrong(&path, format!("maps {of} numbers; robot `{}` needs {needs}", system.name)));
        }
        Ok(())
    }
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, ModelError> {
    let text = read_text(path).map_err(|e| wrong(path, e))?;
    serde_json::from_str(&text).map_err(|e| wrong(path, e))
}

/// Why a model cannot be loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file or folder cannot be read or written, or does not hold what it should.
    #[error("{path}: {reason}", path = path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// A chain's model, and a robot that is not a chain.
    #[error(transparent)]
    Chain(#[from] NoChain),
}

/// An error about a file or folder.
pub(super) fn wrong(path: &Path, reason: impl ToString) -> ModelError {
    ModelError::Folder { path: path.into(), reason: reason.to_string() }
}
