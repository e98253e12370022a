//! `config.json`: what was learned, from what data and how. It is written last, so a folder that has it is complete.

use std::collections::BTreeMap;
use std::path::Path;

use nerd_sim::articulated::Draft;
use nerd_sim::system::System;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

use super::error::{ModelError, read_json, wrong};
use crate::base::Base;
use crate::chain::{self, Chain};
use crate::features::Features;
use crate::form::{Form, View};
use crate::transformer::{Architecture, TransformerConfig};

/// What was learned, from what, how; `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Robot.
    pub robot: String,
    /// Hash of what of the robot decides its motion ([`System::robot_sha256`]).
    #[serde(default)]
    pub robot_sha256: String,
    /// The solver and preset that is the truth, for example `articulated accurate`.
    pub truth: String,
    /// What its predictions are added to.
    #[serde(default)]
    pub base: Base,
    /// Where its tokens are seen from.
    #[serde(default, skip_serializing_if = "own")]
    pub view: View,
    /// Shape of the network.
    pub network: TransformerConfig,
    /// Hash of all that decides its predictions ([`super::Model::sha256`]); [`super::Model::save`] writes it.
    #[serde(default)]
    pub model_sha256: String,
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
    pub provenance: BTreeMap<String, String>,
}

impl ModelConfig {
    /// That of a model's folder. Its network can be, whatever the other files hold.
    ///
    /// # Errors
    /// If there is none, or none that can be.
    pub fn read(folder: &Path) -> Result<Self, ModelError> {
        let path = folder.join("config.json");
        let config: Self = read_json(&path)?;
        config.network.check().map_err(|reason| wrong(&path, format!("network: {reason}")))?;
        if let Base::Draft(n) = config.base
            && !(1..=Draft::MOST).contains(&n)
        {
            return Err(wrong(&path, format!("base: a draft of {n} substeps, 1 to {} are possible", Draft::MOST)));
        }
        Ok(config)
    }

    /// The truth of the model in a folder.
    ///
    /// # Errors
    /// As [`Self::read`], and if this program knows no truth of that name.
    pub fn truth_of(folder: &Path) -> Result<Truth, ModelError> {
        let name = Self::read(folder)?.truth;
        Truth::named(&name).map_err(|e| wrong(&folder.join("config.json"), e.to_string()))
    }

    /// In which form it sees and predicts motion.
    pub fn form(&self) -> Form {
        Form { base: self.base, view: self.view }
    }

    /// Refuses another robot's model, and one of another truth if one is named; by name, as far as names go.
    pub(super) fn check(&self, folder: &Path, system: &System, truth: Option<&str>) -> Result<(), ModelError> {
        let other =
            |what, found: &str, wanted: &str| ModelError::Other { path: folder.into(), what, found: found.into(), wanted: wanted.into() };
        if self.robot != system.name {
            return Err(other("robot", &self.robot, &system.name));
        }
        if let Some(wanted) = truth.filter(|t| *t != self.truth) {
            return Err(other("truth", &self.truth, wanted));
        }
        let wanted = match self.network.architecture {
            Architecture::Chain => self.chain(folder, system)?,
            _ => widths(system, self.form()),
        };
        let found = (self.network.inputs, self.network.outputs);
        if found != wanted {
            let (of, needs) = (format!("{} to {}", found.0, found.1), format!("{} to {}", wanted.0, wanted.1));
            return Err(wrong(&folder.join("config.json"), format!("maps {of} numbers; robot `{}` needs {needs}", system.name)));
        }
        Ok(())
    }

    /// Numbers that the network of a chain takes and gives; refuses a robot that is none, or another one.
    fn chain(&self, folder: &Path, system: &System) -> Result<(usize, usize), ModelError> {
        let path = folder.join("config.json");
        let chain = Chain::of(system).map_err(|e| wrong(&path, e.to_string()))?;
        if self.network.block != chain.rods {
            return Err(wrong(&path, format!("`block` is {}, robot `{}` has {} rods", self.network.block, system.name, chain.rods)));
        }
        Ok((chain::INPUTS, chain::OUTPUTS))
    }
}

/// Numbers that a network of this form takes and gives.
fn widths(system: &System, form: Form) -> (usize, usize) {
    (Features::inputs(system, form), Features::outputs(system))
}

/// The usual view is left out of files.
fn own(view: &View) -> bool {
    *view == View::Own
}
