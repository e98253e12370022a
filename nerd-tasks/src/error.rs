//! Why there is no such task.

use nerd_sim::system::SystemError;

/// Why there is no such task.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// No built-in task of this name, of which the second are all, and no such file.
    #[error("no task `{0}`: choose from {1}, or the path of a task's .toml")]
    Unknown(String, String),
    /// A built-in task, of the second robot; the third are for any.
    #[error("task `{0}` is for `{1}`: those for any robot are {2}")]
    Other(String, &'static str, String),
    /// A file that could not be read, or whose text is wrong.
    #[error("task `{0}`: {1}")]
    File(String, String),
    /// Its robot.
    #[error(transparent)]
    Robot(#[from] SystemError),
}
