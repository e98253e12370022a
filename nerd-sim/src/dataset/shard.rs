//! One recording as a safetensors file, written whole or not at all.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::recording::{Recording, sha256_of};
use crate::files::FileError;
use crate::solver::StepError;

/// Why data could not be made, written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A file that cannot be read or written, or holds something else.
    #[error(transparent)]
    File(#[from] FileError),
    /// Nothing that can be made.
    #[error("{0}")]
    Config(String),
    /// The solver failed in the batch that begins with this trajectory.
    #[error("trajectories from {0}: {1}")]
    Step(u64, #[source] StepError),
}

/// The one entry of a shard's safetensors metadata: safetensors writes several in random order, and the same data are to
/// be the same bytes.
const ENTRY: &str = "recording";

/// Form of shards and their manifest. The first had f32 arrays and did not know the system.
pub const FORMAT: u32 = 2;
const FORMAT_KEY: &str = "format";
/// Of the recording, so that a damaged file is known for one.
const HASH_KEY: &str = "sha256";

/// Writes `recording` with `metadata` and [`FORMAT`] in the header (as JSON): to a temporary name first, then renamed.
pub fn write_shard(path: &Path, recording: &Recording, metadata: &BTreeMap<String, String>) -> Result<(), FileError> {
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
            (name, [vec![recording.trajectories], shape].concat(), bytes)
        })
        .collect();
    let views = raw.iter().map(|(name, shape, bytes)| Ok((*name, TensorView::new(Dtype::F64, shape.clone(), bytes).map_err(wrong)?)));
    let bytes = safetensors::serialize(views.collect::<Result<Vec<_>, FileError>>()?, Some(metadata)).map_err(wrong)?;
    crate::files::write(path, &bytes).map_err(|e| FileError::new(path, e))
}

/// Reads a shard and its metadata; refuses one whose numbers were changed since.
pub fn read_shard(path: &Path) -> Result<(Recording, BTreeMap<String, String>), FileError> {
    let bytes = std::fs::read(path).map_err(|e| FileError::new(path, e))?;
    let wrong = |reason: String| FileError::new(path, reason);
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| wrong(e.to_string()))?;
    let file = SafeTensors::deserialize(&bytes).map_err(|e| wrong(e.to_string()))?;
    let text = header.metadata().as_ref().and_then(|m| m.get(ENTRY)).ok_or_else(|| wrong(format!("no `{ENTRY}` in its metadata")))?;
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
    let [trajectories, rows, _] = shape[..] else { return Err(wrong("`states` has not three axes".into())) };
    let [torques, normals, points, depths, gravity] = ["torques", "normals", "points", "depths", "gravity"].map(read);
    let recording = Recording {
        trajectories,
        frames: rows.saturating_sub(1),
        states,
        torques: torques?.1,
        normals: normals?.1,
        points: points?.1,
        depths: depths?.1,
        gravity: gravity?.1,
        drawn: file.names().contains(&"drawn").then(|| read("drawn")).transpose()?.unwrap_or_default().1,
    };
    if metadata.remove(HASH_KEY) != Some(sha256_of([recording.sha256()])) {
        return Err(wrong("its numbers are not those it was written with (SHA-256 differs); record the data set again".into()));
    }
    Ok((recording, metadata))
}

/// Refuses data of another form than [`FORMAT`].
pub(super) fn check_format(found: Option<u32>) -> Result<(), String> {
    match found {
        Some(FORMAT) => Ok(()),
        found => Err(format!("is data of format {}, not {FORMAT}; record the data set again", found.unwrap_or(1))),
    }
}
