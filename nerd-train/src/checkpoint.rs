//! Checkpoints of a training run: `last.safetensors`, from which it continues, and `best.safetensors`, the weights with the smallest
//! criterion. Each is replaced atomically.

use nerd_sim::files::FileError;

use crate::prelude::*;

/// The state of the run in a folder.
pub fn last(folder: &Path) -> PathBuf {
    folder.join("last.safetensors")
}

/// The best weights of the run in a folder.
pub fn best(folder: &Path) -> PathBuf {
    folder.join("best.safetensors")
}

/// Writes `state` as flat f32 vectors, and the run's configuration (JSON) beside it.
///
/// # Errors
/// If the folder cannot be written; then an older file at `path` is untouched.
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

/// The configuration that was saved with a state.
pub(crate) fn config(path: &Path) -> Result<String> {
    Ok(Tensors::open(path)?.word("config")?.into())
}

/// Reads the state of a run with this network, and the configuration saved beside it.
///
/// # Errors
/// If the file is absent, cut short or no checkpoint, or was made for another network.
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
    let state = LearnerState { step: file.parsed("step")?, weights, average: vector("average")?, m: vector("m")?, v: vector("v")? };
    Ok((state, file.word("config")?.into()))
}

/// Weights that had the smallest criterion.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Updates done.
    pub step: u64,
    /// What they were chosen by.
    pub criterion: f64,
    /// The averaged weights.
    pub weights: Weights,
}

impl Best {
    /// Writes them as named tensors, with what they were chosen by.
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

    /// Those of the run, whose text it is, in its folder; none if there is no file, or it is another run's.
    ///
    /// # Errors
    /// If the file cannot be read, was cut short or changed.
    pub fn load(folder: &Path, run: &str) -> Result<Option<Self>> {
        let path = best(folder);
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |e: Error| {
            let reason = if let Error::File(FileError { reason, .. }) = e { reason } else { e.to_string() };
            let path = path.display();
            Error::Refused(format!("{path} is damaged: {reason}; move it away, and the run rewrites it from its last checkpoint"))
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

/// SHA-256 of weights, as lower-case hex.
fn hash(weights: &Weights) -> String {
    let bytes: Vec<u8> = weights.flat.iter().flat_map(|x| x.to_le_bytes()).collect();
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

fn json(config: &TransformerConfig) -> String {
    serde_json::to_string(config).unwrap_or_default()
}
