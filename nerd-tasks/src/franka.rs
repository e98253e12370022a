//! What both reach tasks of the Franka share (paper A.3.1.3). World up is +z, there is no gravity; m, rad, s.
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

use crate::{View, Work};

/// End effector in the frame of link 7 (m).
const TOOL: Vector3<f64> = Vector3::new(0.0, 0.0, 0.212_07);
/// Box of targets (m), low and high.
const TARGETS: [[f64; 2]; 3] = [[0.3, 0.7], [-0.35, 0.35], [0.05, 0.45]];

/// Joints; also numbers of an action.
pub(crate) const JOINTS: usize = 7;
/// Numbers of an observation.
pub(crate) const OBSERVATION: usize = JOINTS + 6;
/// Steps of an episode.
pub(crate) const EPISODE: u64 = 128;

/// World position of the end effector (m).
pub(crate) fn tool(view: View, work: &mut Work) -> Vector3<f64> {
    kinematics(&work.system.robot, view.state, &mut work.data);
    point_position(&work.data, JOINTS - 1, &TOOL)
}

pub(crate) fn observe(view: View, work: &mut Work, out: &mut [f64]) {
    out[..JOINTS].copy_from_slice(&view.state[..JOINTS]);
    out[JOINTS..JOINTS + 3].copy_from_slice(tool(view, work).as_slice());
    out[JOINTS + 3..].copy_from_slice(view.goal);
}

pub(crate) fn reward(view: View, work: &mut Work) -> f64 {
    let d = (tool(view, work) - vector(view.goal)).norm();
    let peak = |k: f64| 1.0 / ((k * d).exp() + (-k * d).exp() + 1e-4);
    -d + peak(50.0) + peak(300.0)
}

pub(crate) fn draw_goal(rng: &mut ChaCha8Rng, out: &mut [f64]) {
    out.iter_mut().zip(TARGETS).for_each(|(x, [low, high])| *x = low + (high - low) * rng.random::<f64>());
}
