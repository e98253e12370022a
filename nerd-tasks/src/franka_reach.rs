//! The Franka reaches for a point (paper A.3.1.3),
//! commanding joint positions or torques. World up is +z, there is no gravity; m, rad, s.
//!
//! Observation: seven joint angles, position of the end effector, target (13). The end effector is a point of link 7, the
//! base is at the world's origin. With e its distance vector to the target and eps = 1e-4,
//!
//! ```text
//! R = -d + 1 / (exp(50 d) + exp(-50 d) + eps) + 1 / (exp(300 d) + exp(-300 d) + eps),   d = |e|
//! ```
//!
//! Never over; truncated after 128 steps. Targets: `x ~ U(0.3, 0.7)`, `y ~ U(-0.35, 0.35)`, `z ~ U(0.05, 0.45)`; starts:
//! the `reset` ranges of `franka.toml`, default pose +- 0.125 rad at rest.

use crate::About;
use crate::formula::{Formulas, Number, Sight};

/// The task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrankaReach {
    /// Action: change of the joint angles, 1 is 0.03125 rad from where the joint is, through the position law of
    /// `franka.toml`, `tau = clamp(kp (target - q) - kd qd, gain)`, computed in each of a step's two frames of 1/120 s.
    Position,
    /// Action: torque of seven joints, 1 is 87 N m at the first four and 12 N m at the others; a step is one frame of 1/120 s.
    /// Velocities are not observed, so a policy needs more than one observation.
    Torque,
}

/// End effector in the frame of link 7 (m).
const TOOL: [f64; 3] = [0.0, 0.0, 0.212_07];
/// Box of targets (m), low and high.
const TARGETS: [[f64; 2]; 3] = [[0.3, 0.7], [-0.35, 0.35], [0.05, 0.45]];
/// Distance within which it is there (m).
const NEAR: f64 = 0.05;

/// Joints; also numbers of an action.
const JOINTS: usize = 7;

impl Formulas for FrankaReach {
    fn about(&self) -> About {
        let (name, frames) = if *self == Self::Position { ("franka-reach", 2) } else { ("franka-reach-torque", 1) };
        About { name, robot: "franka", scene: "free", observation: JOINTS + 6, action: JOINTS, steps: 128, frames }
    }

    fn goal(&self) -> &[[f64; 2]] {
        &TARGETS
    }

    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        (0..JOINTS).for_each(|k| out[k] = sight.q(k));
        out[JOINTS..JOINTS + 3].copy_from_slice(&sight.place(JOINTS - 1, TOOL));
        (0..3).for_each(|k| out[JOINTS + 3 + k] = sight.goal(k));
    }

    fn act<N: Number>(&self, sight: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        if *self == Self::Position {
            return sight.controlled(action, torques);
        }
        let gains = sight.system().joint_specs().map(|joint| joint.gain.unwrap_or(joint.torque));
        torques.iter_mut().zip(gains).zip(action).for_each(|((tau, gain), a)| *tau = N::from(gain) * *a);
    }

    /// The way to the target (dm), and slow joints.
    fn residuals<N: Number>(&self, sight: &mut impl Sight<N>) -> Vec<N> {
        let tool = sight.place(JOINTS - 1, TOOL);
        let way = (0..3).map(|k| N::from(10.0) * (tool[k] - sight.goal(k)));
        way.chain((0..JOINTS).map(|k| N::from(0.1) * sight.qd(k))).collect()
    }

    fn miss<N: Number>(&self, sight: &mut impl Sight<N>) -> Option<N> {
        Some(distance(sight) / N::from(NEAR))
    }

    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _torques: &[N]) -> N {
        let d = distance(sight);
        let peak = |k: f64| N::from(1.0) / ((N::from(k) * d).exp() + (N::from(-k) * d).exp() + N::from(1e-4));
        -d + peak(50.0) + peak(300.0)
    }
}

/// Of the end effector from its target (m).
fn distance<N: Number>(sight: &mut impl Sight<N>) -> N {
    let tool = sight.place(JOINTS - 1, TOOL);
    (0..3).fold(N::from(0.0), |sum, k| sum + (tool[k] - sight.goal(k)).squared()).sqrt()
}
