//! Loads and saves models. A model is a folder: `config.json`, `normalizer.json`, `model.safetensors` and a model card,
//! `README.md`.
//!
//! Models are identified by content. `config.json` contains a hash of the robot learned and a hash of everything that
//! determines predictions: shape of the network, form, normaliser, weights. So another robot of the same name is
//! refused, and so is a file changed or copied from another folder.

mod config;

use std::{collections::HashMap, path::Path};

use nerd_sim::files::{hex, write};
use nerd_sim::range::within;
use sha2::{Digest, Sha256};

use crate::prelude::*;

pub use config::{ModelConfig, ModelError};

use crate::normalizer::{Moments, Normalizer};
use crate::transformer::{Storage, Weights};
use config::{read_json, wrong};

/// A trained network with normaliser and provenance.
#[derive(Clone, Debug)]
pub struct Model {
    /// Robot, data and training of the model (`config.json`).
    pub config: ModelConfig,
    /// Shift and scale of inputs and outputs.
    pub normalizer: Normalizer,
    /// Parameters of the network.
    pub weights: Weights,
}

impl Model {
    /// Loads the model of `system` from a folder. Refuses a model of another robot, another `truth` if one is given
    /// (such as `articulated accurate`, as on the model card), or files that changed since saving.
    pub fn load(folder: &Path, system: &System, truth: Option<&str>) -> Result<Self, ModelError> {
        let model = Self::read(folder, system, truth)?;
        let ModelConfig { robot, robot_sha256, model_sha256, .. } = &model.config;
        let at_hand = system.robot_sha256();
        let read = model.sha256();
        if *robot_sha256 != at_hand {
            let (learned, this) = (short(robot_sha256), short(&at_hand));
            let differ = "its masses, joints, limits or contact points differ";
            return Err(wrong(folder)(format!(
                "learned robot `{robot}` with hash `{learned}`, this one has `{this}`: {differ}"
            )));
        }
        if *model_sha256 != read {
            let (read, written) = (short(&read), short(model_sha256));
            let hashes = format!("hash `{read}`, `config.json` was written with `{written}`");
            return Err(wrong(folder)(format!(
                "its network, normaliser and weights have {hashes}: one of its files has been changed"
            )));
        }
        Ok(model)
    }

    /// As `Model::load`, without checking the hashes. For use after a file was changed, before new hashes are written.
    pub fn read(folder: &Path, system: &System, truth: Option<&str>) -> Result<Self, ModelError> {
        let config = ModelConfig::read(folder)?;
        config.check(folder, system, truth)?;
        let path = folder.join("normalizer.json");
        let normalizer: Normalizer = read_json(&path)?;
        let (inputs, outputs) = (config.network.inputs, config.network.outputs);
        for (name, moments, width) in
            [("inputs", &normalizer.inputs, inputs), ("outputs", &normalizer.outputs, outputs)]
        {
            check(moments, width).map_err(|reason| wrong(&path)(format!("{name}: {reason}")))?;
        }
        let path = folder.join("model.safetensors");
        // Check the size first, so that a file of an impossible size is not read.
        let size = std::fs::metadata(&path).map_err(wrong(&path))?.len();
        Weights::check_size(&config.network, size).map_err(wrong(&path))?;
        let bytes = nerd_sim::files::read(&path).map_err(wrong(&path))?;
        let weights = Weights::from_bytes(config.network, &bytes).map_err(wrong(&path))?;
        Ok(Self { config, normalizer, weights })
    }

    /// SHA-256 of everything that determines predictions, as lower-case hex: truth, form, shape of the network,
    /// moments, weights.
    pub fn sha256(&self) -> String {
        let ModelConfig { truth, base, view, network, .. } = &self.config;
        let shape = serde_json::to_string(&(truth, base, view, network)).unwrap_or_default();
        let mut hash = Sha256::new();
        hash.update((shape.len() as u64).to_le_bytes());
        hash.update(shape);
        if self.config.told {
            hash.update("told");
        }
        let Normalizer { inputs, outputs } = &self.normalizer;
        for column in [&inputs.mean, &inputs.variance, &outputs.mean, &outputs.variance] {
            hash.update((column.len() as u64).to_le_bytes());
            column.iter().for_each(|x| hash.update(x.to_le_bytes()));
        }
        [inputs, outputs].iter().for_each(|moments| hash.update(moments.epsilon.to_le_bytes()));
        // In pieces, since hashing a large network four bytes at a time takes most of a second.
        for piece in self.weights.flat.chunks(4096) {
            hash.update(piece.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>());
        }
        hex(hash.finalize())
    }

    /// Writes the folder, `config.json` last; `card` becomes `README.md`. Computes the configuration's `model_sha256`.
    /// Refuses weights that are not finite once stored.
    pub fn save(&self, folder: &Path, card: &str, storage: Storage) -> Result<(), ModelError> {
        let (moments_path, weights_path) = (folder.join("normalizer.json"), folder.join("model.safetensors"));
        let metadata = HashMap::from([("robot".into(), self.config.robot.clone())]);
        let bytes = self.weights.to_bytes(metadata, storage).map_err(wrong(&weights_path))?;
        let moments = json(&self.normalizer, &moments_path)?;
        // Hash the values as they will be read back: storage may round, and serde_json may change a number's last bit.
        let normalizer = serde_json::from_slice(&moments).map_err(wrong(&moments_path))?;
        let weights = Weights::from_bytes(self.config.network, &bytes).map_err(wrong(&weights_path))?;
        let stored = Self { config: self.config.clone(), normalizer, weights };
        let config = ModelConfig { model_sha256: stored.sha256(), ..stored.config };
        let config_path = folder.join("config.json");
        let config = json(&config, &config_path)?;
        let files = [
            (moments_path, moments),
            (folder.join("README.md"), card.into()),
            (weights_path, bytes),
            (config_path, config),
        ];
        files.iter().try_for_each(|(path, bytes)| write(path, bytes).map_err(wrong(path)))
    }
}

fn json(value: &impl serde::Serialize, path: &Path) -> Result<Vec<u8>, ModelError> {
    Ok((serde_json::to_string_pretty(value).map_err(wrong(path))? + "\n").into_bytes())
}

/// The start of a hash, long enough to tell two apart.
fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}

fn check(moments: &Moments, width: usize) -> Result<(), String> {
    let Moments { mean, variance, epsilon } = moments;
    within("`epsilon`", *epsilon, 1e-30..=1.0, "")?;
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
