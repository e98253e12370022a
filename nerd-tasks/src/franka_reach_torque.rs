//! The Franka reaches for a point, commanding joint torques. World up is +z; observation, reward and starts: `franka.rs`.
//!
//! Action: torque of seven joints, 1 is 87 N m at the first four and 12 N m at the others; a step is one frame of 1/120 s.
//! Velocities are not observed, so a policy needs more than one observation.

use rand_chacha::ChaCha8Rng;

use crate::franka::{EPISODE, JOINTS, OBSERVATION, draw_goal, observe, reward};
use crate::{Task, View, Work};

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrankaReachTorque;

impl Task for FrankaReachTorque {
    fn name(&self) -> &'static str {
        "franka-reach-torque"
    }

    fn robot(&self) -> &'static str {
        "franka"
    }

    fn observation_dim(&self) -> usize {
        OBSERVATION
    }

    fn action_dim(&self) -> usize {
        JOINTS
    }

    fn episode_length(&self) -> u64 {
        EPISODE
    }

    fn goal_dim(&self) -> usize {
        3
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        draw_goal(rng, out);
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        observe(view, work, out);
    }

    fn act(&self, _view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        for ((tau, joint), a) in torques.iter_mut().zip(work.system.joint_specs()).zip(action) {
            *tau = joint.gain.unwrap_or(joint.torque) * a.clamp(-1.0, 1.0);
        }
    }

    fn reward(&self, view: View, _torques: &[f64], work: &mut Work) -> f64 {
        reward(view, work)
    }
}
