//! One gradient on its way back through a frame.

use nalgebra::Rotation3;
use nerd_core::dynamics::{Adjoint, onto};
use nerd_core::frames::own_velocity;

use super::super::spin::arm;
use super::numbers::{COM, Numbers, ORIGIN};
use crate::prelude::*;

/// Gradients by what a substep begins with. Those by the pose and velocity of a floating root are in world axes: by a turn, by a way of its
/// origin, by its angular velocity, by that of its origin.
pub(super) struct Row {
    pub(super) pose: Vec<f64>,
    pub(super) speed: Vec<f64>,
    /// By the rate of the solve before.
    pub(super) rate: Vec<f64>,
    pub(super) torque: Vec<f64>,
    /// By target and speed of each joint's drive.
    pub(super) drives: Vec<[f64; 2]>,
    /// By w of every touch, and by dampings and shares of the joints: of all the frame's substeps so far.
    pub(super) weights: Vec<f64>,
    pub(super) braked: Vec<f64>,
    pub(super) shares: Vec<f64>,
    /// In a substep: by displacements of links, by twists at its start, by a way of the root.
    pub(super) loads: Vec<Wrench>,
    pub(super) starts: Vec<Wrench>,
    pub(super) way: Vector3<f64>,
    /// By the numbers of robot and scene.
    pub(super) numbers: Numbers,
}

impl Row {
    /// From a gradient by the state after the frame, `[2 nv]` in its tangent space; of so many weights.
    pub(super) fn begin(robot: &Robot, state: &[f64], by_next: &[f64], weights: usize, numbers: Numbers) -> Self {
        let (nv, joints, links) = (robot.nv(), robot.joint_count(), robot.links.len());
        let (mut pose, mut speed) = (by_next[..nv].to_vec(), by_next[nv..].to_vec());
        if robot.floating() {
            let (r, [a, b]) = (quaternion(&state[3..7]), own_velocity(state, robot.nq()));
            let [turn, way, by_a, by_b] = [&pose, &pose[3..], &speed, &speed[3..]].map(vector);
            // Numbers in world axes at a turn: R^-1 w changes by R^-1 (dw - t x w).
            set(&mut pose, [r * (turn - a.cross(&by_a) - b.cross(&by_b)), r * way]);
            set(&mut speed, [r * by_a, r * by_b]);
        }
        Self {
            pose,
            speed,
            rate: vec![0.0; nv],
            torque: vec![0.0; joints],
            drives: vec![[0.0; 2]; joints],
            weights: vec![0.0; weights],
            braked: vec![0.0; joints],
            shares: vec![0.0; joints],
            loads: vec![Wrench::default(); links],
            starts: vec![Wrench::default(); links],
            way: Vector3::zeros(),
            numbers,
        }
    }

    /// The gradient by the state before the frame.
    pub(super) fn end(&self, robot: &Robot, state: &[f64]) -> Vec<f64> {
        let mut out = [&self.pose[..], &self.speed].concat();
        if robot.floating() {
            let (r, [a, b]) = (quaternion(&state[3..7]).inverse(), own_velocity(state, robot.nq()));
            let [turn, way, by_w, by_v] = [&self.pose, &self.pose[3..], &self.speed, &self.speed[3..]].map(|x| r * vector(x));
            set(&mut out, [turn + a.cross(&by_w) + b.cross(&by_v), way]);
            set(&mut out[robot.nv()..], [by_w, by_v]);
        }
        out
    }

    /// From gradients by a root's place to those by its link's centre of mass (`sign` -1), at a state; or back.
    pub(super) fn centre(&mut self, robot: &Robot, state: &[f64], sign: f64) {
        if robot.floating() {
            let (r, arm, w) = (quaternion(&state[3..7]), arm(robot, state) * sign, vector(&state[robot.nq()..]));
            let [turn, way, by_w, by_v] = [&self.pose, &self.pose[3..], &self.speed, &self.speed[3..]].map(vector);
            let by_arm = way + by_v.cross(&w);
            set(&mut self.pose, [turn + arm.cross(&by_arm), way]);
            set(&mut self.speed, [by_w + arm.cross(&by_v), by_v]);
            self.numbers.add(COM, 0, (r.inverse() * by_arm * sign).into());
        }
    }

    /// Gradients by the links' inertias of what [`Adjoint::begin`] began with, `Y . I v - L . I a`.
    pub(super) fn inertias(&mut self, robot: &Robot, data: &Data, adjoint: &Adjoint) {
        for i in 0..if self.numbers.asked() { robot.links.len() } else { 0 } {
            let (v, l) = (&data.velocity[i], &adjoint.virtuals[i]);
            self.numbers.inertia(robot, data, i, 1.0, [&v.cross(l), v]);
            self.numbers.inertia(robot, data, i, -1.0, [l, &(data.acceleration[i] + adjoint.quickened[i])]);
        }
    }

    /// What loads on links do along each DoF of the pose, the way of a root apart, and to where their joints are on the links above; in a substep
    /// that looks ahead, or another.
    pub(super) fn unload(&mut self, robot: &Robot, data: &Data, ahead: bool) {
        let way = [3, 4, 5].map(|k| self.pose.get(k).copied().unwrap_or_default());
        onto(robot, data, &mut self.loads, &mut self.pose);
        if robot.floating() {
            (0..3).for_each(|k| self.pose[3 + k] = way[k] + self.way[k]);
            // All links are where they are from the centre of mass of the root's.
            if ahead {
                self.numbers.add(COM, 0, (data.rotation[0].tr_mul(&self.loads[0].lin) * -1.0).into());
            }
        }
        let base = match robot.base {
            Base::Fixed(pose) => pose.rotation.to_rotation_matrix().into_inner(),
            Base::Floating => Matrix3::identity(),
        };
        for (i, link) in robot.links.iter().enumerate().filter(|(_, link)| link.joint.is_some()) {
            let above = link.parent.map_or(&base, |p| &data.rotation[p]);
            self.numbers.add(ORIGIN, i, above.tr_mul(&self.loads[i].lin).into());
        }
    }

    /// Back over a drift of the pose for a time (s) at local velocities `qd`, in which a root turns by `exp(w t)`.
    pub(super) fn drift(&mut self, robot: &Robot, qd: &[f64], time: f64) {
        let dofs = robot.root_dofs();
        self.speed[dofs..].iter_mut().zip(&self.pose[dofs..]).for_each(|(v, x)| *v += time * x);
        if robot.floating() {
            let [by_w, by_v, turn, way] = [&self.speed, &self.speed[3..], &self.pose, &self.pose[3..]].map(vector);
            let phi = vector(qd) * time;
            set(&mut self.speed, [by_w + spread(&phi, &turn) * time, by_v + way * time]);
            set(&mut self.pose, [Rotation3::new(-phi) * turn, way]);
        }
    }
}

/// Writes two vectors.
pub(super) fn set(out: &mut [f64], parts: [Vector3<f64>; 2]) {
    out.iter_mut().zip(parts.iter().flatten()).for_each(|(o, x)| *o = *x);
}

/// What a change d of a rotation vector does to `exp(phi)`, a turn `J d` in fixed axes, the other way: `J^T x`, with
/// `J = 1 + (1 - cos) / phi^2 [phi] + (phi - sin) / phi^3 [phi]^2`.
fn spread(phi: &Vector3<f64>, x: &Vector3<f64>) -> Vector3<f64> {
    let square = phi.norm_squared();
    let (b, c) = if square < 1e-6 {
        (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
    } else {
        let size = square.sqrt();
        ((1.0 - size.cos()) / square, (size - size.sin()) / (square * size))
    };
    let once = phi.cross(x);
    x - once * b + phi.cross(&once) * c
}
