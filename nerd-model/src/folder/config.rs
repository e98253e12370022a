//! `config.json`: robot, data and training of a model; the errors of loading and saving. The file is written last, so a
//! folder with it is complete.

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

/// Robot, data and training of a model: the content of `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Name of the robot.
    pub robot: String,
    /// Hash of the properties of the robot that determine its motion ([`System::robot_sha256`]).
    pub robot_sha256: String,
    /// The solver and preset that the model learned from, for example `articulated accurate`.
    pub truth: String,
    /// The base to which predictions are added.
    #[serde(default)]
    pub base: Base,
    /// Content of tokens.
    #[serde(default, skip_serializing_if = "usual")]
    pub view: View,
    /// Whether tokens end with the drawn parameters of the robot.
    #[serde(default, skip_serializing_if = "usual")]
    pub told: bool,
    /// Shape of the network.
    pub network: TransformerConfig,
    /// Hash of everything that determines predictions ([`super::Model::sha256`]); [`super::Model::save`] writes it.
    pub model_sha256: String,
    /// SHA-256 of the training data.
    pub data_sha256: String,
    /// Number of transitions in the training data.
    pub transitions: usize,
    /// Number of optimiser updates.
    pub updates: u64,
    /// Windows per update.
    pub batch: usize,
    /// Other records: command, machine, commit, seed, minutes.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

impl ModelConfig {
    /// Reads the configuration from a model's folder and checks the shape of the network. The other files are not read.
    pub fn read(folder: &Path) -> Result<Self, ModelError> {
        let path = folder.join("config.json");
        let config: Self = read_json(&path)?;
        config.network.check().map_err(|reason| wrong(&path)(format!("network: {reason}")))?;
        Ok(config)
    }

    /// The truth that the model in `folder` learned from.
    pub fn truth_of(folder: &Path) -> Result<Truth, ModelError> {
        Truth::named(&Self::read(folder)?.truth).map_err(wrong(&folder.join("config.json")))
    }

    /// Form of tokens and predictions.
    pub fn form(&self) -> Form {
        Form { base: self.base, view: self.view, told: self.told }
    }

    /// Refuses a model for another robot's name or another truth (if one is given), or with widths that do not fit the
    /// robot.
    pub(super) fn check(&self, folder: &Path, system: &System, truth: Option<&str>) -> Result<(), ModelError> {
        for (what, found, wanted) in
            [("robot", &self.robot, &*system.name), ("truth", &self.truth, truth.unwrap_or(&self.truth))]
        {
            if found != wanted {
                return Err(wrong(folder)(format!("this model learned {what} `{found}`, not `{wanted}`")));
            }
        }
        let path = folder.join("config.json");
        let wanted = match self.network.architecture {
            Architecture::Chain => {
                let rods = Chain::of(system).map_err(wrong(&path))?.rods;
                if self.network.block != rods {
                    let block = self.network.block;
                    return Err(wrong(&path)(format!("`block` is {block}, robot `{}` has {rods} rods", system.name)));
                }
                (chain::INPUTS, chain::OUTPUTS)
            }
            _ => (Features::inputs(system, self.form()), Features::outputs(system)),
        };
        let found = (self.network.inputs, self.network.outputs);
        if found != wanted {
            let (of, needs) = (format!("{} to {}", found.0, found.1), format!("{} to {}", wanted.0, wanted.1));
            return Err(wrong(&path)(format!("maps {of} numbers; robot `{}` needs {needs}", system.name)));
        }
        Ok(())
    }
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, ModelError> {
    let text = read_text(path).map_err(wrong(path))?;
    serde_json::from_str(&text).map_err(wrong(path))
}

/// Why a model cannot be loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file or folder cannot be read or written, or its content is invalid.
    #[error("{path}: {reason}", path = path.display())]
    Folder {
        /// The file or folder that is wrong.
        path: PathBuf,
        /// What is wrong, in one line.
        reason: String,
    },
    /// A chain's model, for a robot that is not a chain.
    #[error(transparent)]
    Chain(#[from] NoChain),
}

/// An error about a file or folder.
pub(super) fn wrong<E: ToString>(path: &Path) -> impl Fn(E) -> ModelError + '_ {
    move |reason| ModelError::Folder { path: path.into(), reason: reason.to_string() }
}
