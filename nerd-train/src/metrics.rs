//! Training records: one JSON object a line, appended while the run goes on.
//!
//! Every line has a `step`, the number of updates done when it was written. A run that continues from `step` updates
//! first drops the lines it is going to write again (those with a larger `step`), so a file never has two versions
//! of one step, however often the run was stopped.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::checkpoint::CheckpointError;

/// One line of the record.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Line {
    /// Means over the updates since the last such line.
    Train {
        /// Updates done.
        step: u64,
        /// Normalised MSE.
        loss: f32,
        /// Global gradient norm before clipping.
        gradient_norm: f32,
        /// Learning rate of the last update.
        lr: f64,
        /// Training speed, validation excluded.
        windows_per_second: f64,
    },
    /// One validation.
    Validation {
        /// Updates done.
        step: u64,
        /// Normalised MSE of the averaged weights.
        loss: f32,
        /// What checkpoints are chosen by: the hook's value, or else the validation loss.
        criterion: f64,
        /// Whether it is the smallest so far.
        best: bool,
    },
}

/// An open record.
#[derive(Debug)]
pub struct Metrics {
    path: PathBuf,
    file: File,
}

impl Metrics {
    /// Opens or creates the record of a run that has done `step` updates, and drops the lines beyond.
    ///
    /// A line that is no JSON object with a `step` (the last one of a killed run) is dropped too.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn open(path: &Path, step: u64) -> Result<Self, CheckpointError> {
        let io = |source| CheckpointError::Io { path: path.into(), source };
        if path.exists() {
            let lines = BufReader::new(File::open(path).map_err(io)?).lines().collect::<Result<Vec<_>, _>>().map_err(io)?;
            let of = |line: &str| serde_json::from_str::<serde_json::Value>(line).ok()?.get("step")?.as_u64();
            let kept = lines.iter().filter(|l| of(l).is_some_and(|s| s <= step));
            let text: String = kept.flat_map(|l| [l, "\n"]).collect();
            nerd_sim::files::write(path, text.as_bytes()).map_err(io)?;
        }
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(io)?;
        Ok(Self { path: path.into(), file })
    }

    /// Appends one line.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&mut self, line: &impl Serialize) -> Result<(), CheckpointError> {
        let text = serde_json::to_string(line).map_err(std::io::Error::from);
        let written = text.and_then(|text| self.file.write_all(format!("{text}\n").as_bytes()));
        written.map_err(|source| CheckpointError::Io { path: self.path.clone(), source })
    }
}
