//! One gradient (row of a vector-Jacobian product) on its backward pass through a frame.

use nalgebra::Rotation3;
use nerd_core::dynamics::{Adjoint, onto};
use nerd_core::frames::own_velocity;

use super::super::spin::arm;
use super::numbers::{COM, Numbers, ORIGIN};
use crate::prelude::*;

/// Gradients with respect to a substep's inputs. A free root's gradients are in world axes. First in `pose` are its
/// rotation and its origin's displacement; first in `speed`, its angular velocity and its origin's velocity.
pub(super) struct Row {
    pub(super) pose: Vec<f64>,
    pub(super) speed: Vec<f64>,
    /// Gradient with respect to the rate of the stage that is differentiated next.
    pub(super) rate: Vec<f64>,
    pub(super) torque: Vec<f64>,
    /// Gradient with respect to target and speed of each joint's drive.
    pub(super) drives: Vec<[f64; 2]>,
    /// Gradient with respect to w of every touch, accumulated over the frame's substeps so far; `damping_used` and
    /// `shares` accumulate those with respect to the joints' damping and implicit resistance.
    pub(super) weights: Vec<f64>,
    /// Gradient with respect to the trace of a contact's 3x3 w; w across the normal is the trace less w along it.
    pub(super) across: Vec<f64>,
    pub(super) damping_used: Vec<f64>,
    pub(super) shares: Vec<f64>,
    /// Gradient with respect to the wrenches (N, N m) that contacts hold with. `held` is of this stage's
    /// wrenches, from later stages; `holds` is of the wrenches of the stage before, from this stage.
    pub(super) held: Vec<Motion>,
    pub(super) holds: Vec<Motion>,
    /// Gradient with respect to the wrenches held at the substep's start, summed over all its stages.
    pub(super) begun: Vec<Motion>,
    /// Gradients within a substep with respect to displacements of links, twists at its start, and a displacement of
    /// the root.
    pub(super) loads: Vec<Wrench>,
    pub(super) starts: Vec<Wrench>,
    pub(super) way: Vector3<f64>,
    /// Gradient with respect to the numbers of robot and scene.
    pub(super) numbers: Numbers,
}

impl Row {
    /// Starts from a gradient with respect to the state after the frame, `[2 nv]` in its tangent space.
    pub(super) fn begin(robot: &Robot, state: &[f64], grad_next: &[f64], weights: usize, numbers: Numbers) -> Self {
        let nv = robot.nv();
        let joints = robot.joint_count();
        let links = robot.links.len();
        let mut pose = grad_next[..nv].to_vec();
        let mut speed = grad_next[nv..].to_vec();
        if robot.floating() {
            let r = quaternion(&state[3..7]);
            let [a, b] = own_velocity(state, robot.nq());
            let [turn, way, by_a, by_b] = [&pose, &pose[3..], &speed, &speed[3..]].map(vector);
            // A rotation t and a change dw in world axes change the own-axes velocity R^-1 w by R^-1 (dw - t x w).
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
            across: vec![0.0; weights],
            held: vec![Motion::default(); weights],
            holds: vec![Motion::default(); weights],
            begun: vec![Motion::default(); weights],
            damping_used: vec![0.0; joints],
            shares: vec![0.0; joints],
            loads: vec![Wrench::default(); links],
            starts: vec![Wrench::default(); links],
            way: Vector3::zeros(),
            numbers,
        }
    }

    /// Gradient with respect to the state before the frame, `[2 nv]` in its tangent space.
    pub(super) fn end(&self, robot: &Robot, state: &[f64]) -> Vec<f64> {
        let mut out = [&self.pose[..], &self.speed].concat();
        if robot.floating() {
            let r = quaternion(&state[3..7]).inverse();
            let [a, b] = own_velocity(state, robot.nq());
            let [turn, way, by_w, by_v] =
                [&self.pose, &self.pose[3..], &self.speed, &self.speed[3..]].map(|x| r * vector(x));
            set(&mut out, [turn + a.cross(&by_w) + b.cross(&by_v), way]);
            set(&mut out[robot.nv()..], [by_w, by_v]);
        }
        out
    }

    /// Converts gradients between a root's position and velocity at `state` and its link's centre of mass. `sign` -1:
    /// to the centre of mass; 1: back.
    pub(super) fn centre(&mut self, robot: &Robot, state: &[f64], sign: f64) {
        if robot.floating() {
            let r = quaternion(&state[3..7]);
            let arm = arm(robot, state) * sign;
            let w = vector(&state[robot.nq()..]);
            let [turn, way, by_w, by_v] = [&self.pose, &self.pose[3..], &self.speed, &self.speed[3..]].map(vector);
            let by_arm = way + by_v.cross(&w);
            set(&mut self.pose, [turn + arm.cross(&by_arm), way]);
            set(&mut self.speed, [by_w + arm.cross(&by_v), by_v]);
            self.numbers.add(COM, 0, (r.inverse() * by_arm * sign).into());
        }
    }

    /// Adds the gradients with respect to the links' inertias of the function in [`Adjoint::begin`],
    /// `Y . I v - L . I a`.
    pub(super) fn inertias(&mut self, robot: &Robot, data: &Data, adjoint: &Adjoint) {
        for i in 0..if self.numbers.asked() { robot.links.len() } else { 0 } {
            let v = &data.velocity[i];
            let l = &adjoint.virtuals[i];
            self.numbers.inertia(robot, data, i, 1.0, [&v.cross(l), v]);
            self.numbers.inertia(robot, data, i, -1.0, [l, &(data.acceleration[i] + adjoint.quickened[i])]);
        }
    }

    /// Chain rule from displacements of links to the pose's DoFs and the joints' origins on their parent links. The
    /// gradient with respect to a root's displacement gets `self.way` instead. `implicit`: whether the substep is
    /// implicit.
    pub(super) fn unload(&mut self, robot: &Robot, data: &Data, implicit: bool) {
        let way = [3, 4, 5].map(|k| self.pose.get(k).copied().unwrap_or_default());
        onto(robot, data, &mut self.loads, &mut self.pose);
        if robot.floating() {
            (0..3).for_each(|k| self.pose[3 + k] = way[k] + self.way[k]);
            // Positions of all links count from the centre of mass of the root's link.
            if implicit {
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

    /// Backward pass over a drift of the pose for a time (s) at local velocities `qd`; a root rotates by `exp(w t)`.
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

/// Writes two vectors to the first six numbers of `out`.
pub(super) fn set(out: &mut [f64], parts: [Vector3<f64>; 2]) {
    out.iter_mut().zip(parts.iter().flatten()).for_each(|(o, x)| *o = *x);
}

/// `J^T x`, where a change d of the rotation vector phi rotates `exp(phi)` by `J d` in fixed axes.
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
