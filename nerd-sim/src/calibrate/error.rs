//! Why nothing can be fitted.

use crate::solver::StepError;
use crate::system::SystemError;

/// Why nothing can be fitted; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// No such parameter.
    #[error("no parameter `{0}`: choose from {1}")]
    Parameter(String, String),
    /// Not one of this engine's.
    #[error("parameter `{0}` means nothing to this solver; leave it out")]
    Engine(String),
    /// A scene that there is not.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A step of the solver.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A parameter without anything to change.
    #[error("parameter `{0}` has nothing to act on: no gravity, no mass, or no plane of the scene's own; leave it out")]
    Nothing(String),
    /// Nothing to fit to.
    #[error("no trials to fit to")]
    Empty,
}
