//! Trajectories as a safetensors file, written whole or not at all. Numbers are f64: in f32, positions 100 km from the
//! world origin would round to 8 mm.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};

use crate::{internal::*, trajectories::Trajectories};

/// Hash of a data set: SHA-256 over its recordings' hashes in order, as lower-case hex.
pub fn sha256_of(recordings: impl IntoIterator<Item = [u8; 32]>) -> String {
    let mut hash = Sha256::new();
    recordings.into_iter().for_each(|h| hash.update(h));
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Errors of generating, writing or reading data.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A file cannot be read or written, or has other content.
    #[error(transparent)]
    File(#[from] FileError),
    /// The settings are impossible.
    #[error("{0}")]
    Config(String),
    /// The deadline has passed; see [`super::GenerateConfig::until`].
    #[error(
        "time was over while data was recorded, of which nothing is kept; give it more, ask for fewer transitions, or record them into a folder first"
    )]
    Late,
    /// The solver failed in the batch that starts with this trajectory.
    #[error("trajectories from {0}: {1}")]
    Step(u64, #[source] StepError),
}

/// The single entry of a shard's safetensors metadata: safetensors writes several entries in random order, and equal
/// data must give equal bytes.
const ENTRY: &str = "recording";

/// Version of the format of shards and manifest. Version 1 had f32 arrays and did not identify the system.
pub const FORMAT: u32 = 2;
const FORMAT_KEY: &str = "format";
/// Key of the recording's hash, which detects a damaged file.
const HASH_KEY: &str = "sha256";

/// Writes `recording` with `metadata` and [`FORMAT`] in the header (as JSON): to a temporary file, then renamed.
pub fn write_shard(
    path: &Path,
    recording: &Trajectories,
    metadata: &BTreeMap<String, String>,
) -> Result<(), FileError> {
    let own = [(FORMAT_KEY.to_string(), FORMAT.to_string()), (HASH_KEY.to_string(), sha256_of([recording.sha256()]))];
    let metadata: BTreeMap<_, _> = metadata.clone().into_iter().chain(own).collect();
    let text = serde_json::to_string(&metadata).map_err(|e| FileError::new(path, e))?;
    let metadata = HashMap::from([(ENTRY.to_string(), text)]);
    let wrong = |e: safetensors::SafeTensorError| FileError::new(path, e);
    let raw: Vec<_> = recording
        .arrays()
        .into_iter()
        .map(|(name, shape, x)| {
            let bytes: Vec<u8> = x.iter().flat_map(|v| v.to_le_bytes()).collect();
            (name, [vec![recording.count], shape].concat(), bytes)
        })
        .collect();
    let views = raw
        .iter()
        .map(|(name, shape, bytes)| Ok((*name, TensorView::new(Dtype::F64, shape.clone(), bytes).map_err(wrong)?)));
    let bytes = safetensors::serialize(views.collect::<Result<Vec<_>, FileError>>()?, Some(metadata)).map_err(wrong)?;
    crate::files::write(path, &bytes).map_err(|e| FileError::new(path, e))
}

/// Whether a file has the header of a shard, even if its arrays are damaged.
pub(super) fn is_shard(path: &Path) -> bool {
    let bytes = crate::files::read(path).unwrap_or_default();
    let header = SafeTensors::read_metadata(&bytes).map(|(_, header)| header.metadata().clone().unwrap_or_default());
    header.is_ok_and(|words| words.contains_key(ENTRY))
}

/// Reads a shard and its metadata; refuses numbers that do not match the stored hash.
pub fn read_shard(path: &Path) -> Result<(Trajectories, BTreeMap<String, String>), FileError> {
    let bytes = crate::files::read(path).map_err(|e| FileError::new(path, e))?;
    let wrong = |reason: String| FileError::new(path, reason);
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| wrong(e.to_string()))?;
    let file = SafeTensors::deserialize(&bytes).map_err(|e| wrong(e.to_string()))?;
    let text = header
        .metadata()
        .as_ref()
        .and_then(|m| m.get(ENTRY))
        .ok_or_else(|| wrong(format!("no `{ENTRY}` in its metadata")))?;
    let mut metadata: BTreeMap<String, String> = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
    check_format(metadata.remove(FORMAT_KEY).and_then(|f| f.parse().ok())).map_err(wrong)?;
    let read = |name: &str| -> Result<(Vec<usize>, Vec<f64>), FileError> {
        let view = file.tensor(name).map_err(|_| wrong(format!("no array `{name}`")))?;
        if view.dtype() != Dtype::F64 {
            return Err(wrong(format!("array `{name}` is {:?}, not f64", view.dtype())));
        }
        let (numbers, _) = view.data().as_chunks();
        Ok((view.shape().to_vec(), numbers.iter().map(|b| f64::from_le_bytes(*b)).collect()))
    };
    let (shape, states) = read("states")?;
    let [count, rows, _] = shape[..] else { return Err(wrong("`states` has not three axes".into())) };
    let [torques, normals, points, depths, gravity] = ["torques", "normals", "points", "depths", "gravity"].map(read);
    let where_there =
        |name: &str| Ok(file.names().contains(&name).then(|| read(name)).transpose()?.unwrap_or_default().1);
    let recording = Trajectories {
        count,
        frames: rows.saturating_sub(1),
        states,
        torques: torques?.1,
        normals: normals?.1,
        points: points?.1,
        depths: depths?.1,
        gravity: gravity?.1,
        drawn: where_there("drawn")?,
        shown: where_there("shown")?,
        ..Trajectories::default()
    };
    if metadata.remove(HASH_KEY) != Some(sha256_of([recording.sha256()])) {
        return Err(wrong(
            "its numbers are not those it was written with (SHA-256 differs); record the data set again".into(),
        ));
    }
    Ok((recording, metadata))
}

/// Refuses data of a version other than [`FORMAT`].
pub(super) fn check_format(found: Option<u32>) -> Result<(), String> {
    match found {
        Some(FORMAT) => Ok(()),
        found => Err(format!("is data of format {}, not {FORMAT}; record the data set again", found.unwrap_or(1))),
    }
}
