//! The Franka reaches for a point, commanding joint positions. World up is +z; observation, reward and starts: `franka.rs`.
//!
//! Action: change of the joint angles, 1 is 0.03125 rad from where the joint is, through the position law of
//! `franka.toml`, `tau = clamp(kp (target - q) - kd qd, gain)`, reckoned anew in each of a step's two frames of 1/120 s.

use rand_chacha::ChaCha8Rng;

use crate::franka::{EPISODE, JOINTS, OBSERVATION, draw_goal, observe, reward};
use crate::{Task, View, Work};

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrankaReach;

impl Task for FrankaReach {
    fn name(&self) -> &'static str {
        "franka-reach"
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

    fn frames(&self) -> u64 {
        2
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

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        let Work { controller, numbers, .. } = work;
        numbers.clear();
        numbers.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        controller.torques(view.state, numbers, torques);
    }

    fn reward(&self, view: View, _torques: &[f64], work: &mut Work) -> f64 {
        reward(view, work)
    }
}
