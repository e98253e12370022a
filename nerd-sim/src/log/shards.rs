//! Measured trajectories as solvers record theirs.

use nerd_core::dynamics::Data;

use super::Log;
use crate::batch::contacts;
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
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        let mut all = Recording { frames, ..Default::default() };
        for trajectory in &self.trajectories {
            for (states, torques) in trajectory.states.windows(frames + 1).zip(trajectory.torques.windows(frames)).step_by(frames) {
                all.trajectories += 1;
                states.iter().for_each(|s| all.states.extend(s));
                torques.iter().for_each(|t| all.torques.extend(t));
                all.gravity.extend(scene.gravity.iter());
                for state in &states[..frames] {
                    contacts(system, &scene, state, &mut data, &mut events);
                    for event in &events {
                        all.normals.extend(event.normal.iter());
                        all.points.extend(event.p1.iter());
                        all.depths.push(event.distance);
                    }
                }
            }
        }
        Ok(all)
    }
}
