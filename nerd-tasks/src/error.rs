//! Errors of naming and reading a task.

use nerd_sim::system::SystemError;

/// Why a task could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// Neither a built-in task (the second field lists them) nor a file has this name.
    #[error("no task `{0}`: choose from {1}, or the path of a task's .toml")]
    Unknown(String, String),
    /// A built-in task for the second robot; the third lists tasks for any robot.
    #[error("task `{0}` is for `{1}`: those for any robot are {2}")]
    Other(String, &'static str, String),
    /// A file that could not be read, or whose text is wrong.
    #[error("task `{0}`: {1}")]
    File(String, String),
    /// An error of its robot.
    #[error(transparent)]
    Robot(#[from] SystemError),
}
