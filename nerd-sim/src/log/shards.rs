//! Measured trajectories as solvers record theirs.

use nerd_core::dynamics::Data;

use super::data::Log;
use crate::dataset::Recording;
use crate::system::SystemError;

impl Log {
    /// All pieces of `frames` frames (at least 1), one after the other, with the contacts that their poses have in the log's scene.
    ///
    /// # Errors
    /// If the robot has no such scene.
    pub fn recording(&self, frames: usize) -> Result<Recording, SystemError> {
        let frames = frames.max(1);
        let (system, scene) = (&self.system, self.system.scene(&self.scene)?);
        let (mut data, mut all) = (Data::new(&system.robot), Recording::empty(frames));
        for trajectory in &self.trajectories {
            all.cut(system, &scene, &trajectory.states, &trajectory.torques, &mut data);
        }
        Ok(all)
    }
}
