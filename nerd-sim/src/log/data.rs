//! Measured trajectories of a robot.

use super::spec::Published;
use crate::internal::*;

/// Measured trajectories.
#[derive(Clone, Debug)]
pub struct Log {
    /// The robot.
    pub system: Arc<System>,
    /// Where it was.
    pub scene: String,
    /// What was measured, one state a frame.
    pub trajectories: Vec<Trajectory>,
    /// What was done to it, and what looks odd, a line each.
    pub notes: Vec<String>,
    /// What others published of it.
    pub published: Vec<Published>,
}

/// One trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Its name in the file.
    pub id: u64,
    /// States `[q, qd]` as solvers have them, one a frame.
    pub states: Vec<Vec<f64>>,
    /// Torques of the joints, as many.
    pub torques: Vec<Vec<f64>>,
}

/// Why measurements cannot be used; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file that cannot be read, does not say what is needed, or contradicts itself.
    #[error(transparent)]
    File(#[from] FileError),
    /// A robot that cannot be made.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl Log {
    /// Whether any torque acts.
    pub fn driven(&self) -> bool {
        self.trajectories.iter().flat_map(|t| &t.torques).flatten().any(|t| *t != 0.0)
    }
}

pub(super) fn bad(path: &Path, reason: String) -> LogError {
    FileError::new(path, reason).into()
}
