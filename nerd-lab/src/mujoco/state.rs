//! States of ours as MuJoCo's and back. Only a free root differs: ours is `q = [p, quaternion x y z w]`,
//! `qd = [w, p_dot + p x w]` in world axes; MuJoCo's `qpos = [p, quaternion w x y z]`, `qvel = [p_dot, w in body axes]`.

use nerd_core::dynamics::{to_local, to_world};
use nerd_core::robot::Robot;
use nerd_core::state::{quaternion, vector, wrap_state};

/// `[qpos, qvel]` of a state `[q, qd]`.
pub fn to_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        let (w, velocity) = (quaternion(&q[3..7]).inverse() * vector(&qd[..3]), vector(&qd[3..6]));
        q[3..7].rotate_right(1);
        qd[..3].copy_from_slice(velocity.as_slice());
        qd[3..6].copy_from_slice(w.as_slice());
    }
    out
}

/// The state `[q, qd]` of a `[qpos, qvel]`, endless angles wrapped.
pub fn from_mujoco(robot: &Robot, state: &[f64]) -> Vec<f64> {
    let mut out = state.to_vec();
    if robot.floating() {
        let (q, qd) = out.split_at_mut(robot.nq());
        q[3..7].rotate_left(1);
        let (velocity, w) = (vector(&qd[..3]), quaternion(&q[3..7]) * vector(&qd[3..6]));
        qd[..3].copy_from_slice(w.as_slice());
        qd[3..6].copy_from_slice(velocity.as_slice());
        to_world(robot, q, qd);
    }
    wrap_state(robot, &mut out);
    out
}
