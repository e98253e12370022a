//! Why a run, an experiment or a report came to nothing.

use std::path::{Path, PathBuf};

use nerd_model::folder::ModelError;
use nerd_model::pick::PickError;
use nerd_sim::prelude::{StepError, SystemError};
use nerd_sim::truth::UnknownTruth;
use nerd_tasks::TaskError;

use crate::checkpoint::CheckpointError;
use crate::learner::LearnError;
use crate::ppo::{ConfigError, PpoError};
use crate::ranges::OutOfRange;
use crate::ranks::RankError;
use crate::supply::SupplyError;
use crate::trainer::TrainError;

/// What can go wrong between a setting and a figure. One line says what, where and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A robot or scene.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A step of a solver.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A model folder.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A model of a truth that is not there.
    #[error(transparent)]
    Truth(#[from] UnknownTruth),
    /// A choice by a chart.
    #[error(transparent)]
    Pick(#[from] PickError),
    /// A task.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// A data set.
    #[error(transparent)]
    Data(#[from] nerd_sim::dataset::DatasetError),
    /// A setting.
    #[error(transparent)]
    Range(#[from] OutOfRange),
    /// Settings of PPO.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A learner.
    #[error(transparent)]
    Learn(#[from] LearnError),
    /// A run's files.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Fresh data.
    #[error(transparent)]
    Supply(#[from] SupplyError),
    /// A training run.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// Other ranks of a run.
    #[error(transparent)]
    Ranks(#[from] RankError),
    /// A run of PPO.
    #[error(transparent)]
    Ppo(#[from] PpoError),
    /// A file.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the file system said.
        source: std::io::Error,
    },
    /// A file that does not hold what it should.
    #[error("{path}: {reason}", path = path.display())]
    Format {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Settings that mean nothing together, or more than there is.
    #[error("{0}")]
    Refused(String),
}

/// Of this crate's runs and experiments.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Of a file; for `map_err`.
    pub fn file(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        move |source| Self::File { path: path.into(), source }
    }

    /// Of what a file holds; for `map_err`.
    pub fn format<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> Self + '_ {
        move |reason| Self::Format { path: path.into(), reason: reason.to_string() }
    }
}

/// Ends a function with [`Error::Refused`] and these words.
macro_rules! refuse {
    ($($text:tt)*) => { return Err($crate::error::Error::Refused(format!($($text)*))) };
}
pub(crate) use refuse;
