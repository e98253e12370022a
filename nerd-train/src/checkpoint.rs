//! Training states on disk: one safetensors file, replaced as a whole.
//!
//! The file holds `weights`, `average`, `m` and `v` as flat f32 vectors, and in its metadata `step`, `network` (the
//! [`TransformerConfig`] as JSON) and `config` (whatever JSON the run wants to keep). It is written under a temporary
//! name in the same folder and renamed, so whoever reads the final name sees an old or a new file, never half of one.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use nerd_model::transformer::{TransformerConfig, Weights};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::learner::LearnerState;

/// A checkpoint that cannot be written, read or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What went wrong.
        source: io::Error,
    },
    /// The file is no checkpoint: cut short, or made by something else.
    #[error("{path} is no training checkpoint: {reason}")]
    Format {
        /// File concerned.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file is one of a run, but not as it was written.
    #[error("{path} is damaged: {reason}; move it away and the run makes it anew from its last checkpoint on")]
    Damaged {
        /// File concerned.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file belongs to another network.
    #[error("{path} holds the network {found}, this run asks for {expected}")]
    Network {
        /// File concerned.
        path: PathBuf,
        /// Its network, as JSON.
        found: String,
        /// The run's network, as JSON.
        expected: String,
    },
}

/// Writes `state` and the run's configuration (JSON) to `path`.
///
/// # Errors
/// If the folder cannot be written; then an older file at `path` is untouched.
pub fn save(path: &Path, state: &LearnerState, config: &str) -> Result<(), CheckpointError> {
    let metadata = [("step", state.step.to_string()), ("network", json(&state.weights.config)), ("config", config.to_owned())];
    let metadata: HashMap<String, String> = metadata.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    let vectors = vectors(state).map(|(name, x)| (name, x.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()));
    let format = |e: safetensors::SafeTensorError| CheckpointError::Format { path: path.into(), reason: e.to_string() };
    let views = vectors.iter().map(|(name, bytes)| Ok((*name, TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes)?)));
    let views = views.collect::<Result<Vec<_>, _>>().map_err(format)?;
    let bytes = safetensors::serialize(views, Some(metadata)).map_err(format)?;
    nerd_sim::files::write(path, &bytes).map_err(|source| CheckpointError::Io { path: path.into(), source })
}

/// Reads the state of a run with this network, and the configuration saved beside it.
///
/// # Errors
/// If the file is absent, cut short or no checkpoint, or was made for another network.
pub fn load(path: &Path, network: &TransformerConfig) -> Result<(LearnerState, String), CheckpointError> {
    let bytes = std::fs::read(path).map_err(|source| CheckpointError::Io { path: path.into(), source })?;
    let format = |reason: String| CheckpointError::Format { path: path.into(), reason };
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| format(e.to_string()))?;
    let metadata =
        |key: &str| header.metadata().as_ref().and_then(|m| m.get(key)).ok_or_else(|| format(format!("no `{key}` in its metadata")));
    let found: TransformerConfig = serde_json::from_str(metadata("network")?).map_err(|e| format(format!("network: {e}")))?;
    if found != *network {
        return Err(CheckpointError::Network { path: path.into(), found: json(&found), expected: json(network) });
    }
    let step = metadata("step")?.parse().map_err(|e| format(format!("step: {e}")))?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(|e| format(e.to_string()))?;
    let vector = |name: &str| {
        let view = tensors.tensor(name).map_err(|e| format(e.to_string()))?;
        if view.dtype() != Dtype::F32 || view.shape() != [network.parameters()] {
            return Err(format(format!("`{name}` is {:?} {:?}, expected f32 [{}]", view.dtype(), view.shape(), network.parameters())));
        }
        let numbers: Vec<f32> = view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        match numbers.iter().position(|x| !x.is_finite()) {
            Some(entry) => Err(format(format!("`{name}`: entry {entry} is {}", numbers[entry]))),
            None => Ok(numbers),
        }
    };
    let weights = Weights { config: found, flat: vector("weights")? };
    let state = LearnerState { step, weights, average: vector("average")?, m: vector("m")?, v: vector("v")? };
    Ok((state, metadata("config")?.clone()))
}

fn vectors(state: &LearnerState) -> [(&'static str, &[f32]); 4] {
    [("weights", &state.weights.flat), ("average", &state.average), ("m", &state.m), ("v", &state.v)]
}

fn json(config: &TransformerConfig) -> String {
    serde_json::to_string(config).unwrap_or_default()
}
