//! The best weights of a run: `best.safetensors`, named tensors with what they were chosen by in the metadata.

use std::collections::HashMap;
use std::path::Path;

use nerd_model::transformer::{Storage, TransformerConfig, Weights};
use safetensors::tensor::SafeTensors;
use sha2::{Digest, Sha256};

use crate::checkpoint::CheckpointError;

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

/// Its file in a run's folder.
const FILE: &str = "best.safetensors";

impl Best {
    pub(crate) fn save(&self, folder: &Path, run: &str) -> Result<(), CheckpointError> {
        let path = folder.join(FILE);
        let network = serde_json::to_string(&self.weights.config).unwrap_or_default();
        let words = [
            ("step", self.step.to_string()),
            ("criterion", self.criterion.to_string()),
            ("network", network),
            ("config", run.to_owned()),
            ("sha256", hash(&self.weights)),
        ];
        let words: HashMap<_, _> = words.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        let format = |e: nerd_model::transformer::WeightsError| CheckpointError::Format { path: path.clone(), reason: e.to_string() };
        let bytes = self.weights.to_bytes(words, Storage::F32).map_err(format)?;
        nerd_sim::files::write(&path, &bytes).map_err(|source| CheckpointError::Io { path, source })
    }

    /// Those of the run, whose text it is, in its folder; none if there is no file, or it is another run's.
    ///
    /// # Errors
    /// If the file cannot be read, was cut short or changed.
    pub fn load(folder: &Path, run: &str) -> Result<Option<Self>, CheckpointError> {
        let path = folder.join(FILE);
        let bytes = match std::fs::read(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            read => read.map_err(|source| CheckpointError::Io { path: path.clone(), source })?,
        };
        let damaged = |reason: String| CheckpointError::Damaged { path: path.clone(), reason };
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| damaged(e.to_string()))?;
        let words = header.metadata().as_ref().ok_or_else(|| damaged("it has no metadata".into()))?;
        let word = |key: &str| words.get(key).ok_or_else(|| damaged(format!("no `{key}` in its metadata")));
        if word("config")? != run {
            return Ok(None);
        }
        let step = word("step")?.parse().map_err(|e| damaged(format!("step: {e}")))?;
        let criterion = word("criterion")?.parse().map_err(|e| damaged(format!("criterion: {e}")))?;
        let network: TransformerConfig = serde_json::from_str(word("network")?).map_err(|e| damaged(format!("network: {e}")))?;
        let weights = Weights::from_bytes(network, &bytes).map_err(|e| damaged(e.to_string()))?;
        // Files of before have none.
        if words.get("sha256").is_some_and(|wanted| *wanted != hash(&weights)) {
            return Err(damaged("its weights are not those that were written (SHA-256 differs)".into()));
        }
        Ok(Some(Self { step, criterion, weights }))
    }
}

fn hash(weights: &Weights) -> String {
    let bytes: Vec<u8> = weights.flat.iter().flat_map(|w| w.to_le_bytes()).collect();
    Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect()
}
