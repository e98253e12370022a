//! The Franka reaches for a point (paper A.3.1.3),
//! commanding joint positions or torques. World up is +z, there is no gravity; m, rad, s.
//!
//! Observation: seven joint angles, position of the end effector, target (13). The end effector is a point of link 7, the
//! base stands at the world's origin. With e its distance vector to the target and eps = 1e-4,
//!
//! ```text
//! R = -d + 1 / (exp(50 d) + exp(-50 d) + eps) + 1 / (exp(300 d) + exp(-300 d) + eps),   d = |e|
//! ```
//!
//! Never over; truncated after 128 steps. Targets: `x ~ U(0.3, 0.7)`, `y ~ U(-0.35, 0.35)`, `z ~ U(0.05, 0.45)`; starts:
//! the reset law of `franka.toml`, default pose +- 0.125 rad at rest.

use nalgebra::Vector3;
use nerd_core::dynamics::{kinematics, point_position};
use nerd_core::state::vector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::{Task, View, Work};

/// The task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrankaReach {
    /// Action: change of the joint angles, 1 is 0.03125 rad from where the joint is, through the position law of
    /// `franka.toml`, `tau = clamp(kp (target - q) - kd qd, gain)`, reckoned anew in each of a step's two frames of 1/120 s.
    Position,
    /// Action: torque of seven joints, 1 is 87 N m at the first four and 12 N m at the others; a step is one frame of 1/120 s.
    /// Velocities are not observed, so a policy needs more than one observation.
    Torque,
}

/// End effector in the frame of link 7 (m).
const TOOL: Vector3<f64> = Vector3::new(0.0, 0.0, 0.212_07);
/// Box of targets (m), low and high.
const TARGETS: [[f64; 2]; 3] = [[0.3, 0.7], [-0.35, 0.35], [0.05, 0.45]];

/// Joints; also numbers of an action.
const JOINTS: usize = 7;

/// World position of the end effector (m).
fn tool(view: View, work: &mut Work) -> Vector3<f64> {
    kinematics(&work.system.robot, view.state, &mut work.data);
    point_position(&work.data, JOINTS - 1, &TOOL)
}

impl Task for FrankaReach {
    fn name(&self) -> &'static str {
        match self {
            Self::Position => "franka-reach",
            Self::Torque => "franka-reach-torque",
        }
    }

    fn robot(&self) -> &'static str {
        "franka"
    }

    fn observation_dim(&self) -> usize {
        JOINTS + 6
    }

    fn action_dim(&self) -> usize {
        JOINTS
    }

    fn episode_length(&self) -> u64 {
        128
    }

    fn frames(&self) -> u64 {
        match self {
            Self::Position => 2,
            Self::Torque => 1,
        }
    }

    fn goal_dim(&self) -> usize {
        3
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        out.iter_mut().zip(TARGETS).for_each(|(x, [low, high])| *x = low + (high - low) * rng.random::<f64>());
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        out[..JOINTS].copy_from_slice(&view.state[..JOINTS]);
        out[JOINTS..JOINTS + 3].copy_from_slice(tool(view, work).as_slice());
        out[JOINTS + 3..].copy_from_slice(view.goal);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        let Work { controller, numbers, system, .. } = work;
        numbers.clear();
        numbers.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        match self {
            Self::Position => controller.torques(view.state, numbers, torques),
            Self::Torque => {
                for ((tau, joint), a) in torques.iter_mut().zip(system.joint_specs()).zip(numbers) {
                    *tau = joint.gain.unwrap_or(joint.torque) * *a;
                }
            }
        }
    }

    fn reward(&self, view: View, _torques: &[f64], work: &mut Work) -> f64 {
        let d = (tool(view, work) - vector(view.goal)).norm();
        let peak = |k: f64| 1.0 / ((k * d).exp() + (-k * d).exp() + 1e-4);
        -d + peak(50.0) + peak(300.0)
    }
}
