//! Why a row cannot be measured.

use crate::solver::StepError;
use crate::system::SystemError;

/// Why the suite, or a row of it, could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No row has that word in its name.
    #[error("no row is called `{word}`; choose from {known}")]
    Row {
        /// The word.
        word: String,
        /// Names of the rows.
        known: String,
    },
    /// The world of a row could not be made.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The solver failed where nothing is measured yet.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The row compares a method with itself at four times the substeps, and the method has no such setting.
    #[error("the method names no finer setting (`Method::finer`)")]
    NoFiner,
}
