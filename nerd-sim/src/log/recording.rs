//! A log as solvers record: pieces of equal length, contacts found by the scene's geometry.

use super::data::{Log, LogError, Trajectory};
use crate::dataset::Recording;
use crate::prelude::*;

impl Log {
    /// Pieces of so many frames. Neighbours share `shared` frames, so that of a trajectory's runs of `shared + 1` frames each is in
    /// one piece; its last piece ends where it does. Shorter trajectories are left out.
    pub fn recording(&self, trajectories: &[Trajectory], frames: usize, shared: usize) -> Result<Recording, LogError> {
        let (robot, scene) = (&self.system.robot, self.system.scene(&self.scene)?);
        let mut out = Recording { frames, ..Recording::default() };
        let (mut data, mut events) = (Data::new(robot), Vec::new());
        for trajectory in trajectories {
            let Some(last) = (trajectory.states.len() - 1).checked_sub(frames) else { continue };
            let starts = (0..last).step_by((frames - shared.min(frames - 1)).max(1)).chain([last]);
            for first in starts {
                out.trajectories += 1;
                out.gravity.extend(scene.gravity.iter());
                for frame in first..=first + frames {
                    let state = &trajectory.states[frame];
                    if frame < first + frames {
                        out.torques.extend(&trajectory.torques[frame]);
                        contacts(robot, &scene, state, &mut data, &mut events);
                        out.normals.extend(events.iter().flat_map(|e| e.normal.iter().copied().collect::<Vec<_>>()));
                        out.points.extend(events.iter().flat_map(|e| e.p1.iter().copied().collect::<Vec<_>>()));
                        out.depths.extend(events.iter().map(|e| e.distance));
                    }
                    out.states.extend(state);
                }
            }
        }
        Ok(out)
    }
}
