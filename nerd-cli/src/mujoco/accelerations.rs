//! Compares a robot's accelerations with MuJoCo's at the same states.

use std::f64::consts::PI;

use nalgebra::DMatrix;
use nerd_sim::sampling::stream;
use rand::RngExt;
use serde_json::json;

use super::{python::Python, states::to_mujoco};
use crate::prelude::*;

/// If all accelerations of both engines are below this (m/s^2, rad/s^2), their difference is not divided by them.
const NONE: f64 = 1e-9;

/// Returns the largest difference between our accelerations and MuJoCo's over `count` random states. It is relative to
/// MuJoCo's largest acceleration at the state, or absolute (m/s^2, rad/s^2) if all are near 0. Contact, limits, dry
/// friction and actuators are off. MuJoCo's equations are projected onto our coordinates, so mimic joints follow their
/// leading joints in both. A URDF is converted to MJCF first.
pub fn apart(python: &Path, path: &Path, system: &System, count: u64) -> Result<f64> {
    let robot = &system.robot;
    let model = match path.extension().is_some_and(|ending| ending == "xml") {
        true => json!({ "frame_time": 0.0, "path": path }),
        false => json!({ "frame_time": 0.0, "mjcf": nerd_sim::mjcf::mjcf(system, &*system.scene("free")?, &[])? }),
    };
    let mut python = Python::of_model(python, model)?;
    let states = (0..count).map(|k| state(robot, k)).collect_vec();
    let dofs = robot.dofs();
    let root = robot.root_dofs();
    let coords = robot.root_coords();
    let joints =
        robot.links.iter().zip(&dofs).filter_map(|(link, dof)| Some((link.joint.as_ref()?, *dof))).collect_vec();
    let along = DMatrix::from_fn(root + joints.len(), robot.nv(), |row, column| match row.checked_sub(root) {
        None => f64::from(u8::from(row == column)),
        Some(k) if joints[k].1 == column => joints[k].0.ratio(),
        Some(_) => 0.0,
    });
    let theirs = states.iter().map(|state| {
        let state = to_mujoco(robot, state);
        let (q, qd) = state.split_at(robot.nq());
        let positions = joints
            .iter()
            .map(|(joint, dof)| joint.ratio() * q[coords + dof - root] + joint.mimic().map_or(0.0, |m| m.offset));
        let rates = &along * nalgebra::DVector::from_column_slice(qd);
        q[..coords].iter().copied().chain(positions).chain(rates.iter().copied()).collect_vec()
    });
    let rows = along.row_iter().map(|row| row.iter().copied().collect_vec()).collect_vec();
    let theirs: Vec<Vec<f64>> = python.ask(&json!({ "accelerate": theirs.collect_vec(), "along": rows }))?;
    let mut worst = 0.0f64;
    for (state, theirs) in states.iter().zip(theirs) {
        let ours = accelerations(system, state)?;
        let gap = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let [own, size] = [&ours, &theirs].map(|all| all.iter().map(|x| x.abs()).fold(0.0, f64::max));
        worst = worst.max(if own.max(size) < NONE { gap } else { gap / size.max(NONE) });
    }
    Ok(worst)
}

/// Draws the k-th random state `[q, qd]`: joints within their limits, velocities up to 2 rad/s or 2 m/s.
fn state(robot: &Robot, k: u64) -> Vec<f64> {
    let mut rng = stream(17, k);
    let mut state = robot.zero_state();
    let nq = robot.nq();
    let coords = robot.root_coords();
    state.iter_mut().for_each(|x| *x = rng.random_range(-2.0..2.0));
    for (q, joint) in state[coords..nq].iter_mut().zip(robot.joints()) {
        let free = if joint.kind == JointKind::Prismatic { 1.0 } else { PI };
        let [low, high] = joint.limit.map_or([-free, free], |limit| [limit.lower.max(-10.0), limit.upper.min(10.0)]);
        *q = low + (high - low) * rng.random_range(0.0..1.0);
    }
    if robot.floating() {
        let turn = UnitQuaternion::from_euler_angles(state[3], state[4], state[5]);
        write_quaternion(&mut state[3..7], &turn);
    }
    state
}

/// Computes our forward dynamics at `state`, in MuJoCo's layout. A floating root has its linear acceleration in world
/// axes, then its angular acceleration in root axes.
fn accelerations(system: &System, state: &[f64]) -> Result<Vec<f64>> {
    let robot = &system.robot;
    let (q, twist) = system.robot.split(state);
    let local = twist.to_local(robot, q);
    let mut tau = vec![0.0; robot.nv()];
    let root = robot.root_dofs();
    for (k, joint) in robot.joints().enumerate() {
        tau[root + k] =
            -joint.damping * local.0[root + k] - joint.stiffness * (q[robot.root_coords() + k] - joint.rest);
    }
    let mut out = system.data().forward_dynamics(robot, q, &local, &tau, &system.gravity())?.as_slice().to_vec();
    if robot.floating() {
        out[..6].rotate_left(3);
        let turned = quaternion(&q[3..7]).inverse() * vector(&out[3..6]);
        out[3..6].copy_from_slice(turned.as_slice());
    }
    Ok(out)
}
