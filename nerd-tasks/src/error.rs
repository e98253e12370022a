//! Errors of finding and reading a task.

use nerd_sim::system::SystemError;

/// Why a task could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// No built-in task and no file has this name; the second field lists the built-in ones.
    #[error("no task `{0}`: choose from {1}, or the path of a task's .toml")]
    Unknown(String, String),
    /// A built-in task that was applied to another robot. The second field is the task's own robot; the third lists the
    /// tasks for any robot.
    #[error("task `{0}` is for `{1}`: those for any robot are {2}")]
    Other(String, &'static str, String),
    /// A file that cannot be read, or with invalid text.
    #[error("task `{0}`: {1}")]
    File(String, String),
    /// An error of the task's robot.
    #[error(transparent)]
    Robot(#[from] SystemError),
}
