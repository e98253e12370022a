//! Why a model cannot be loaded or saved.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::chain::NoChain;

/// Why a model cannot be loaded or saved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file system said no.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: std::io::Error,
    },
    /// Not what the file should hold.
    #[error("{path}: {reason}", path = path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// One line.
        reason: String,
    },
    /// The model was made for something else.
    #[error("{path}: this model learned {what} `{found}`, not `{wanted}`", path = path.display())]
    Other {
        /// The folder.
        path: PathBuf,
        /// `robot` or `truth`.
        what: &'static str,
        /// What it learned.
        found: String,
        /// What was asked for.
        wanted: String,
    },
    /// The robot has the name of the one that was learned, and is another.
    #[error(
        "{path}: learned robot `{robot}` {}, this is {}: its masses, joints, limits or contact points differ",
        short(found), short(wanted), path = path.display()
    )]
    Robot {
        /// The folder.
        path: PathBuf,
        /// Name of both.
        robot: String,
        /// Hash of the one that was learned.
        found: String,
        /// Hash of the one at hand.
        wanted: String,
    },
    /// Network, normaliser or weights are not those the folder was written with.
    #[error(
        "{path}: its network, normaliser and weights are {}, `config.json` was written with {}: one of its files has been changed",
        short(found), short(wanted), path = path.display()
    )]
    Changed {
        /// The folder.
        path: PathBuf,
        /// Hash of what is there.
        found: String,
        /// Hash in `config.json`.
        wanted: String,
    },
    /// The model of a chain, and a robot that it cannot be of.
    #[error(transparent)]
    Chain(#[from] NoChain),
    /// The folder does not say which robot or which weights it is of.
    #[error("{path}: `config.json` has no `{key}`, so nothing tells whether it fits; train it again, or save it anew after `Model::stamp`", path = path.display())]
    NoStamp {
        /// The folder.
        path: PathBuf,
        /// What is absent.
        key: &'static str,
    },
}

/// The start of a hash, enough to tell two apart.
fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}

pub(super) fn wrong(path: &Path, reason: impl Into<String>) -> ModelError {
    ModelError::Format { path: path.into(), reason: reason.into() }
}

pub(super) fn file(path: &Path) -> impl Fn(std::io::Error) -> ModelError + '_ {
    move |source| ModelError::File { path: path.into(), source }
}

pub(super) fn read_json<T: for<'a> Deserialize<'a>>(path: &Path) -> Result<T, ModelError> {
    let text = nerd_sim::files::read_text(path).map_err(file(path))?;
    serde_json::from_str(&text).map_err(|e| wrong(path, e.to_string()))
}
