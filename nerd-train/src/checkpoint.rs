//! Checkpoints of a training run: `last.safetensors`, the state to resume from, and `best.safetensors`, the weights
//! with the smallest criterion. Each file is replaced atomically.

use nerd_sim::files::FileError;

use crate::prelude::*;

/// Path of the state of the run in `folder`.
pub fn last(folder: &Path) -> PathBuf {
    folder.join("last.safetensors")
}

/// Path of the best weights of the run in `folder`.
pub fn best(folder: &Path) -> PathBuf {
    folder.join("best.safetensors")
}

/// Writes `state` as flat f32 vectors, with the run's configuration (JSON) in the metadata.
///
/// # Errors
/// If the folder cannot be written. An older file at `path` then stays as it was.
pub fn save(path: &Path, state: &LearnerState, config: &str) -> Result<()> {
    let mut file = Tensors::default();
    for (name, x) in [("weights", &state.weights.flat), ("average", &state.average), ("m", &state.m), ("v", &state.v)] {
        file.put_f32(name, &[x.len()], x);
    }
    file.put_word("step", state.step.to_string());
    file.put_word("network", json(&state.weights.config));
    file.put_word("config", config);
    file.save(path)
}

/// Reads the run's configuration (JSON) from the checkpoint at `path`.
pub(crate) fn config(path: &Path) -> Result<String> {
    Ok(Tensors::open(path)?.word("config")?.into())
}

/// Reads a run's state and its configuration (JSON). The run must have trained this `network`.
///
/// # Errors
/// If the file is absent, truncated, not a checkpoint, or from a run with another network.
pub fn load(path: &Path, network: &TransformerConfig) -> Result<(LearnerState, String)> {
    let file = Tensors::open(path)?;
    let found: TransformerConfig = file.json("network")?;
    if found != *network {
        return Err(file.wrong(format!("it holds the network {}, this run asks for {}", json(&found), json(network))));
    }
    let vector = |name: &str| {
        let numbers = file.f32(name, Some(network.parameters()))?;
        match numbers.iter().find(|x| !x.is_finite()) {
            Some(x) => Err(file.wrong(format!("`{name}` holds {x}"))),
            None => Ok(numbers),
        }
    };
    let weights = Weights { config: found, flat: vector("weights")? };
    let state = LearnerState {
        step: file.parsed("step")?,
        weights,
        average: vector("average")?,
        m: vector("m")?,
        v: vector("v")?,
    };
    Ok((state, file.word("config")?.into()))
}

/// The weights with the smallest criterion so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Number of optimiser updates that gave these weights.
    pub step: u64,
    /// Value of the criterion, see [`crate::trainer`].
    pub criterion: f64,
    /// Moving average of the weights.
    pub weights: Weights,
}

impl Best {
    /// Writes the weights as named tensors, with step and criterion.
    pub(crate) fn save(&self, folder: &Path, run: &str) -> Result<()> {
        let mut file = Tensors::default();
        file.put_network(&self.weights.config.tensors(), &self.weights.flat);
        file.put_word("step", self.step.to_string());
        file.put_word("criterion", self.criterion.to_string());
        file.put_word("network", json(&self.weights.config));
        file.put_word("config", run);
        file.put_word("sha256", hash(&self.weights));
        file.save(&best(folder))
    }

    /// Reads the best weights from `folder`. Returns `None` if there is no file, or its configuration (JSON) differs
    /// from `run`.
    ///
    /// # Errors
    /// If the file cannot be read, is truncated or was changed.
    pub fn load(folder: &Path, run: &str) -> Result<Option<Self>> {
        let path = best(folder);
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |e: Error| {
            let reason = if let Error::File(FileError { reason, .. }) = e { reason } else { e.to_string() };
            let path = path.display();
            Error::Refused(format!(
                "{path} is damaged: {reason}; move it away, and the run rewrites it from its last checkpoint"
            ))
        };
        Self::read(&path, run).map_err(damaged)
    }

    fn read(path: &Path, run: &str) -> Result<Option<Self>> {
        let file = Tensors::open(path)?;
        if file.word("config")? != run {
            return Ok(None);
        }
        let config: TransformerConfig = file.json("network")?;
        let weights = Weights { config, flat: file.network(&config.tensors())? };
        if file.word("sha256")? != hash(&weights) {
            return Err(file.wrong("its weights are not those that were written (SHA-256 differs)"));
        }
        Ok(Some(Self { step: file.parsed("step")?, criterion: file.parsed("criterion")?, weights }))
    }
}

/// SHA-256 of the weights, as lower-case hex.
fn hash(weights: &Weights) -> String {
    hex(Sha256::digest(weights.flat.iter().flat_map(|x| x.to_le_bytes()).collect_vec()))
}

fn json(config: &TransformerConfig) -> String {
    serde_json::to_string(config).unwrap_or_default()
}
