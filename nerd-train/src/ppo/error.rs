//! Why a run of PPO cannot begin or go on.

use nerd_sim::solver::StepError;

use super::config::ConfigError;
use crate::error::{Error, part};
use crate::ranks::RankError;

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PpoError {
    /// Settings that cannot be.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The solver failed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// Another rank is gone.
    #[error(transparent)]
    Ranks(#[from] RankError),
    /// A file failed.
    #[error(transparent)]
    File(#[from] Error),
    /// The device that the policy answers and learns on failed.
    #[error("device: {0}")]
    Device(String),
    /// The policy stopped being numbers.
    #[error("iteration {0}: a weight of the policy is not finite")]
    NotFinite(u64),
    /// Environments of another number or shape than the settings say.
    #[error("{found} environments, the settings ask for {wanted}")]
    Environments {
        /// How many there are.
        found: usize,
        /// How many should be.
        wanted: usize,
    },
}

part!(PpoError);
