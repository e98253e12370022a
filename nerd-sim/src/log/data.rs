//! Measured trajectories of a robot.

use super::spec::Published;
use crate::internal::*;

/// Measured trajectories.
#[derive(Clone, Debug)]
pub struct Log {
    /// Origin of the data, in words.
    pub about: Option<String>,
    /// Time (us) of a frame on one core, if a simulator made the data.
    pub cost: Option<f64>,
    /// The robot.
    pub system: Arc<System>,
    /// Name of its scene.
    pub scene: String,
    /// Measurements, one state a frame.
    pub trajectories: Vec<Trajectory>,
    /// Corrections made, and oddities, a line each.
    pub notes: Vec<String>,
    /// Groups of trajectories that are held out together, by name; each trajectory is in one group, or there are none.
    pub folds: Vec<Vec<u64>>,
    /// Published results on these measurements.
    pub published: Vec<Published>,
}

/// One trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Its name in the file.
    pub id: u64,
    /// States `[q, qd]` as solvers have them, one a frame.
    pub states: Vec<Vec<f64>>,
    /// Torques of the joints, one row for each state.
    pub torques: Vec<Vec<f64>>,
}

/// Why measurements cannot be used; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file that cannot be read, lacks required entries, or contradicts itself.
    #[error(transparent)]
    File(#[from] FileError),
    /// A robot that cannot be read.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl Log {
    /// Fails unless every trajectory is in one fold, if there are folds.
    pub(super) fn parted(&self) -> Result<(), String> {
        let mut all: Vec<u64> = self.folds.concat();
        all.sort_unstable();
        let known: std::collections::BTreeSet<u64> = self.trajectories.iter().map(|t| t.id).collect();
        match known.iter().copied().eq(all.iter().copied()) || all.is_empty() {
            true => Ok(()),
            false => Err(format!("`folds` have the trajectories {all:?}: each of {known:?} has to be in one of them")),
        }
    }

    /// Whether any torque acts.
    pub fn driven(&self) -> bool {
        self.trajectories.iter().flat_map(|t| &t.torques).flatten().any(|t| *t != 0.0)
    }
}

pub(super) fn bad(path: &Path, reason: String) -> LogError {
    FileError::new(path, reason).into()
}
