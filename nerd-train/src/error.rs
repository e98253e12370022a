//! Errors of this crate.

use nerd_model::folder::ModelError;
use nerd_model::pick::PickError;
use nerd_sim::files::FileError;
use nerd_tasks::TaskError;

/// One line that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read or written, or does not hold what it should.
    #[error(transparent)]
    File(#[from] FileError),
    /// Settings that mean nothing together, or more than there is.
    #[error("{0}")]
    Refused(String),
    /// Broken off: see [`crate::stop`].
    #[error("stopped")]
    Stopped,
    /// What a part says: a robot, a solver, a model, a data set, a learner.
    #[error(transparent)]
    Part(Box<dyn std::error::Error + Send + Sync>),
}

/// Of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Of a file; for `map_err`.
    pub fn file<E: ToString>(path: &Path) -> impl Fn(E) -> Self + '_ {
        move |reason| FileError::new(path, reason).into()
    }
}

/// Ends a function with [`Error::Refused`] and these words.
macro_rules! refuse {
    ($($text:tt)*) => { return Err($crate::error::Error::Refused(format!($($text)*))) };
}
pub(crate) use refuse;

/// Makes the error of a part one of the crate. Each part does so in its own module, so this file depends on no part.
macro_rules! part {
    ($($error:ty),+) => { $(
        impl From<$error> for $crate::error::Error {
            fn from(error: $error) -> Self {
                Self::Part(Box::new(error))
            }
        }
    )+ };
}
use crate::prelude::*;
pub(crate) use part;

part!(SystemError, StepError, ModelError, PickError, TaskError, DatasetError);
#[cfg(feature = "cuda")]
part!(nerd_cuda::DeviceError);
