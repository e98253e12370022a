//! Measured trajectories of a robot.

use super::spec::Published;
use crate::internal::*;

/// Measured trajectories.
#[derive(Clone, Debug)]
pub struct Log {
    /// Origin of the data, in words.
    pub about: Option<String>,
    /// Computation time (us) of a frame on one core, if a simulator made the data.
    pub cost: Option<f64>,
    /// The robot.
    pub system: Arc<System>,
    /// Name of the scene.
    pub scene: String,
    /// Measurements, one state per frame.
    pub trajectories: Vec<Trajectory>,
    /// Corrections made and oddities found, one line each.
    pub notes: Vec<String>,
    /// Groups of trajectory numbers, held out together in cross-validation. Each trajectory is in one group, or there
    /// are no groups.
    pub folds: Vec<Vec<u64>>,
    /// Published results on these measurements.
    pub published: Vec<Published>,
}

/// One trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Number of the trajectory in the file.
    pub id: u64,
    /// States `[q, qd]` in the form of the solvers, one per frame.
    pub states: Vec<Vec<f64>>,
    /// Joint torques (N m or N), one row per state.
    pub torques: Vec<Vec<f64>>,
}

impl Trajectory {
    /// Number of frames between its states.
    pub fn frames(&self) -> usize {
        self.states.len() - 1
    }

    /// First frames of pieces of `frames` frames, `every` frames apart.
    pub fn starts(&self, frames: usize, every: usize) -> impl Iterator<Item = usize> + use<> {
        (0..(self.frames() + 1).saturating_sub(frames)).step_by(every.max(1))
    }
}

/// Errors of reading a log; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file cannot be read, lacks required entries, or contradicts itself.
    #[error(transparent)]
    File(#[from] FileError),
    /// The robot cannot be read.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl Log {
    /// Fails if there are folds and a trajectory is not in exactly one.
    pub(super) fn parted(&self) -> Result<(), String> {
        let mut all: Vec<u64> = self.folds.concat();
        all.sort_unstable();
        let known: std::collections::BTreeSet<u64> = self.trajectories.iter().map(|t| t.id).collect();
        match known.iter().copied().eq(all.iter().copied()) || all.is_empty() {
            true => Ok(()),
            false => Err(format!("`folds` have the trajectories {all:?}: each of {known:?} has to be in one of them")),
        }
    }

    /// Whether any torque is not zero.
    pub fn driven(&self) -> bool {
        self.trajectories.iter().flat_map(|t| &t.torques).flatten().any(|t| *t != 0.0)
    }
}

pub(super) fn bad(path: &Path, reason: String) -> LogError {
    FileError::new(path, reason).into()
}
