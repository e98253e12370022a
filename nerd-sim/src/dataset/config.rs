//! Settings of a recording: amount, starts, drives.

use std::time::Instant;

use super::{drive::Pilot, shard::DatasetError};
use crate::internal::*;

/// Maximum memory of a shard (GB).
const MOST_GIGABYTES: f64 = 16.0;

/// Settings of data generation.
#[derive(Clone, Debug)]
pub struct GenerateConfig {
    /// Total number of transitions, rounded up to whole trajectories.
    pub transitions: usize,
    /// Frames per trajectory (paper: 100).
    pub frames: usize,
    /// Seed (training 0, validation 10 in the paper).
    pub seed: u64,
    /// Trajectories per shard.
    pub shard_trajectories: usize,
    /// Range of a factor on the torque amplitudes, drawn once per trajectory (paper: always 1). Trajectories with
    /// negative draws are passive ([`super::Drive::draw`]).
    pub torque_scale: Range,
    /// Maximum number of frames that an action is held; drawn once per trajectory, log-uniformly (paper: 1).
    pub hold: usize,
    /// Share of the trajectories that start from the reset ranges of evaluations and tasks (paper: 0).
    pub resets: f64,
    /// A policy that acts in place of random torques, from its own starts, and its share of the trajectories (paper:
    /// none).
    pub pilot: Option<(Arc<dyn Pilot>, f64)>,
    /// Deadline after which recording ends with [`DatasetError::Late`] (default: none).
    pub until: Option<Instant>,
}

impl Default for GenerateConfig {
    fn default() -> Self {
        let torque_scale = Range { low: 1.0, high: 1.0 };
        Self {
            transitions: 1_000_000,
            frames: 100,
            seed: 0,
            shard_trajectories: 2048,
            torque_scale,
            hold: 1,
            resets: 0.0,
            pilot: None,
            until: None,
        }
    }
}

impl GenerateConfig {
    /// Total number of trajectories.
    pub fn trajectories(&self) -> usize {
        self.transitions.div_ceil(self.frames.max(1))
    }

    /// Refuses impossible settings; the error names the number.
    pub fn check(&self, system: &System) -> Result<(), DatasetError> {
        let within = |what: &str, x: f64, range| {
            within(format_args!("data: {what}"), x, range, "").map_err(DatasetError::Config)
        };
        within("transitions", self.transitions as f64, 1.0..=1e12)?;
        within("frames", self.frames as f64, 1.0..=1e6)?;
        within("shard_trajectories", self.shard_trajectories as f64, 1.0..=1e6)?;
        within("hold", self.hold as f64, 1.0..=1e6)?;
        if self.hold > 1 && system.spec.smooth.is_some() {
            let text = "data: hold is for torques that jump, and this robot's run along smooth curves; leave it at 1, or `smooth` out of the robot's TOML";
            return Err(DatasetError::Config(text.into()));
        }
        within("resets", self.resets, 0.0..=1.0)?;
        law("data: torque_scale", &self.torque_scale, -1e6..=1e6, "").map_err(DatasetError::Config)?;
        within("the pilot's share", self.pilot.as_ref().map_or(0.0, |(_, share)| *share), 0.0..=1.0)?;
        let robot = &system.robot;
        let row = robot.state_dim() + robot.joint_count() + 7 * robot.contact_points.len();
        let gigabytes =
            (self.shard_trajectories.min(self.trajectories()) * (self.frames + 1)) as f64 * row as f64 * 8e-9;
        if gigabytes > MOST_GIGABYTES {
            return Err(DatasetError::Config(format!(
                "data: a shard of {} trajectories of {} frames takes {gigabytes:.0} GB; at most {MOST_GIGABYTES} are allowed, take fewer",
                self.shard_trajectories, self.frames
            )));
        }
        Ok(())
    }
}
