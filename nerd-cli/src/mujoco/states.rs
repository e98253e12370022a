//! States in MuJoCo's form.

use nerd_core::dynamics::{to_local, to_world};
use nerd_core::state::wrap_state;
use nerd_sim::solver::Fault;

use crate::prelude::*;

// Our states differ from MuJoCo's only for a floating root. Ours is `q = [p, quaternion x y z w]`, `qd = [w, p_dot + p
// x w]` in world axes. MuJoCo's is `qpos = [p, quaternion w x y z]`, `qvel = [p_dot, w in body axes]`.

/// Converts a state `[q, qd]` to MuJoCo's `[qpos, qvel]`.
pub fn to_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        let w = quaternion(&q[3..7]).inverse() * vector(&qd[..3]);
        let velocity = vector(&qd[3..6]);
        q[3..7].rotate_right(1);
        qd[..3].copy_from_slice(velocity.as_slice());
        qd[3..6].copy_from_slice(w.as_slice());
    }
    out
}

/// Converts the states `[q, qd]` of all environments to MuJoCo's `[qpos, qvel]`.
pub fn all_to_mujoco(batch: &Batch) -> Vec<Vec<f64>> {
    (0..batch.len()).map(|env| to_mujoco(&batch.system.robot, batch.state(env))).collect()
}

/// Converts MuJoCo's `[qpos, qvel]` to a state `[q, qd]`, with angles of unlimited joints wrapped.
pub fn from_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        q[3..7].rotate_left(1);
        let velocity = vector(&qd[..3]);
        let w = quaternion(&q[3..7]) * vector(&qd[3..6]);
        qd[..3].copy_from_slice(w.as_slice());
        qd[3..6].copy_from_slice(velocity.as_slice());
        to_world(robot, q, qd);
    }
    wrap_state(robot, &mut out);
    out
}

/// Stores MuJoCo's `state` of environment `env` in `states`; if MuJoCo gave it up, adds a fault.
pub fn take(batch: &Batch, env: usize, state: Option<Vec<f64>>, states: &mut [f64], faults: &mut Vec<Fault>) {
    let robot = &batch.system.robot;
    let d = batch.system.robot.state_dim();
    match state {
        Some(state) => states[env * d..][..d].copy_from_slice(&from_mujoco(robot, &state)),
        None => faults.push(Fault { env, frame: batch.frames[env], reason: "MuJoCo gave it up".into() }),
    }
}
