//! Trajectories of equal length in memory, trajectory-major, in f64: in f32, positions 100 km from the world's origin would round to 8 mm.

use sha2::{Digest, Sha256};

use crate::system::System;

/// Everything recorded of some trajectories: F frames each, states before and after.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Number of trajectories.
    pub trajectories: usize,
    /// Frames of each.
    pub frames: usize,
    /// States `[trajectory][F + 1][state_dim]`.
    pub states: Vec<f64>,
    /// Joint torques held over each frame, `[trajectory][F][joints]`.
    pub torques: Vec<f64>,
    /// Surface normals at the frame's start, world axes, `[trajectory][F][points][3]`.
    pub normals: Vec<f64>,
    /// Nearest scene points at the frame's start, world (m), `[trajectory][F][points][3]`.
    pub points: Vec<f64>,
    /// Signed distances at the frame's start (m), `[trajectory][F][points]`; infinite in an empty scene.
    pub depths: Vec<f64>,
    /// Gravity (m/s^2), `[trajectory][3]`.
    pub gravity: Vec<f64>,
    /// What was drawn of the robot's own numbers, `[trajectory][crate::vary::columns]`; empty where nothing varies.
    pub drawn: Vec<f64>,
}

impl Recording {
    /// The arrays by name, with the shape of one trajectory; `drawn` only where something varies.
    pub fn arrays(&self) -> Vec<(&'static str, Vec<usize>, &Vec<f64>)> {
        let (n, f) = (self.trajectories, self.frames);
        let width = |x: &Vec<f64>, rows: usize| x.len().checked_div(n * rows).unwrap_or(0);
        let contacts = width(&self.depths, f);
        let mut arrays = vec![
            ("states", vec![f + 1, width(&self.states, f + 1)], &self.states),
            ("torques", vec![f, width(&self.torques, f)], &self.torques),
            ("normals", vec![f, contacts, 3], &self.normals),
            ("points", vec![f, contacts, 3], &self.points),
            ("depths", vec![f, contacts], &self.depths),
            ("gravity", vec![3], &self.gravity),
        ];
        if !self.drawn.is_empty() {
            arrays.push(("drawn", vec![width(&self.drawn, 1)], &self.drawn));
        }
        arrays
    }

    /// Says which array is not as long as a robot's must be, if one is not: a file may have been made before the robot changed.
    pub fn check(&self, system: &System) -> Result<(), String> {
        let robot = &system.robot;
        let (n, f, points) = (self.trajectories, self.frames, robot.contact_points.len());
        let (states, torques, surface) = (n * (f + 1) * robot.state_dim(), n * f * robot.joint_count(), n * f * points);
        for ((name, _, x), wanted) in self.arrays().iter().zip([states, torques, 3 * surface, 3 * surface, surface, 3 * n]) {
            if x.len() != wanted {
                return Err(format!("`{name}` has {} numbers, the robot needs {wanted}; record the data set again", x.len()));
            }
        }
        let (drawn, wanted) = (self.drawn.len(), n * crate::vary::columns(system).len());
        if drawn != wanted {
            return Err(format!("`drawn` has {drawn} numbers, [vary] of the robot draws {wanted}; record the data set again"));
        }
        Ok(())
    }

    /// SHA-256 over the arrays in order.
    pub fn sha256(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        for (_, _, x) in self.arrays() {
            let bytes: Vec<u8> = x.iter().flat_map(|v| v.to_le_bytes()).collect();
            hash.update(&bytes);
        }
        hash.finalize().into()
    }
}

/// One hash of a whole data set: SHA-256 over its recordings' hashes in order, as lower-case hex.
pub fn sha256_of(recordings: impl IntoIterator<Item = [u8; 32]>) -> String {
    let mut hash = Sha256::new();
    recordings.into_iter().for_each(|h| hash.update(h));
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}
