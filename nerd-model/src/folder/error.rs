//! Why a model cannot be loaded or saved.

use std::path::{Path, PathBuf};

use crate::chain::NoChain;

/// Why a model cannot be loaded or saved.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// A file or folder cannot be read or written, or does not hold what it should.
    #[error("{path}: {reason}", path = path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// The model of a chain, and a robot that it cannot be of.
    #[error(transparent)]
    Chain(#[from] NoChain),
}

/// What is wrong with a file or folder.
pub(super) fn wrong(path: &Path, reason: impl ToString) -> ModelError {
    ModelError::Folder { path: path.into(), reason: reason.to_string() }
}
