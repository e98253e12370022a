//! Errors of this crate.

use nerd_model::chain::NoChain;
use nerd_model::folder::ModelError;
use nerd_sim::files::FileError;
use nerd_tasks::TaskError;

/// An error whose message is one line: what failed, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read or written, or has the wrong content.
    #[error(transparent)]
    File(#[from] FileError),
    /// Settings that contradict each other, or ask for more memory or time than there is.
    #[error("{0}")]
    Refused(String),
    /// Work was interrupted by a signal or a time limit; see [`crate::stop`].
    #[error("stopped")]
    Stopped,
    /// An error of a robot, solver, model, task, data set, learner or device.
    #[error(transparent)]
    Part(Box<dyn std::error::Error + Send + Sync>),
}

/// The `Result` of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl From<String> for Error {
    fn from(reason: String) -> Self {
        Self::Refused(reason)
    }
}

impl Error {
    /// An error about the file at `path`, for `map_err`.
    pub fn file<E: ToString>(path: &Path) -> impl Fn(E) -> Self + '_ {
        move |reason| FileError::new(path, reason).into()
    }
}

/// Returns [`Error::Refused`] with a formatted message.
macro_rules! refuse {
    ($($text:tt)*) => { return Err($crate::error::Error::Refused(format!($($text)*))) };
}
pub(crate) use refuse;

/// Implements `From` for these error types, which become [`Error::Part`]. Modules of this crate call it for their own
/// errors, so this file depends on none of them.
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

part!(SystemError, StepError, ModelError, NoChain, TaskError, DatasetError);
#[cfg(feature = "cuda")]
part!(nerd_cuda::DeviceError);
