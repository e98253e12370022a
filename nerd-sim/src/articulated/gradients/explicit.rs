//! Backward pass over Runge-Kutta's substeps, stage by stage.

use nalgebra::Quaternion;

use super::super::kept::Flown;
use super::super::memory::{Flight, Memory};
use super::Place;
use super::numbers::{DAMPING, GRAVITY};
use super::row::{Row, set};
use crate::prelude::*;

impl Row {
    /// Backward pass over the frame's substeps.
    pub(super) fn back_flights(&mut self, place: Place, flights: &[Flown], memory: &mut Memory) {
        let Place { system, scene, .. } = place;
        let robot = &system.robot;
        let dt = system.frame_time * 4.0 / flights.len() as f64;
        for stages in flights.chunks_exact(4).rev() {
            let own = &mut memory.flight;
            own.end.copy_from_slice(&stages[0].state);
            for (weight, stage) in [1.0, 2.0, 2.0, 1.0].into_iter().zip(stages) {
                own.end.iter_mut().zip(&stage.rate).for_each(|(x, r)| *x += weight / 6.0 * dt * r);
            }
            self.numbers(robot, &own.end, &mut own.by_end);
            own.by_state.copy_from_slice(&own.by_end);
            own.by_stage.fill(0.0);
            // Weights of a stage's rate in the next stage's state, and in the substep's end.
            for (stage, (next, weight)) in stages.iter().zip([(0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)]).rev() {
                let own = &mut memory.flight;
                let sums =
                    own.by_end.iter().zip(&own.by_stage).map(|(end, stage)| dt * (weight / 6.0 * end + next * stage));
                own.by_rate.iter_mut().zip(sums).for_each(|(b, sum)| *b = sum);
                self.back_rate((robot, &scene.gravity), stage, memory);
                let own = &mut memory.flight;
                own.by_state.iter_mut().zip(&own.by_stage).for_each(|(s, t)| *s += t);
            }
            self.take_numbers(robot, &stages[0].state, &memory.flight.by_state);
        }
    }

    /// Backward pass over a stage's rate, `explicit::rate`: writes the gradient with respect to the numbers of the
    /// stage's state to `by_stage`. Uses the row's pose and speed as working memory.
    fn back_rate(&mut self, (robot, gravity): (&Robot, &Vector3<f64>), stage: &Flown, memory: &mut Memory) {
        let nq = robot.nq();
        let dofs = robot.root_dofs();
        let coords = robot.root_coords();
        let Memory { adjoint, flight: Flight { by_stage, by_rate, virtuals, qdd, .. }, .. } = memory;
        let data = &stage.data;
        let (q, qd) = stage.state.split_at(nq);
        virtuals.copy_from_slice(&by_rate[nq..]);
        qdd.copy_from_slice(&stage.rate[nq..]);
        self.pose.fill(0.0);
        self.speed[dofs..].copy_from_slice(&by_rate[coords..nq]);
        if robot.floating() {
            let [w, v, by] = [qd, &qd[3..], &by_rate[nq + 3..]].map(vector);
            let turn = w.cross(&v);
            (0..3).for_each(|k| qdd[3 + k] -= turn[k]);
            let by_w = (raw_quaternion(&by_rate[3..]) * raw_quaternion(&q[3..]).conjugate()).imag() * 0.5;
            set(&mut self.speed, [by_w + v.cross(&by), vector(by_rate) + by.cross(&w)]);
        }
        stage.factor.solve(virtuals);
        self.loads.fill(Wrench::default());
        adjoint.begin(robot, data, (virtuals, qdd), gravity, &mut self.loads);
        self.inertias(robot, data, adjoint);
        let by_base = adjoint.end(robot, data, (virtuals, qd, qdd), &mut self.loads, &mut self.speed);
        self.numbers.add(GRAVITY, 0, (-by_base).into());
        self.unload(robot, data, false);
        for (i, joint) in robot.joints().enumerate() {
            let own = virtuals[dofs + i];
            self.torque[i] += own;
            self.speed[dofs + i] -= joint.damping * own;
            self.numbers.add(DAMPING, i, [-qd[dofs + i] * own, 0.0, -qdd[dofs + i] * own]);
            if let Some(limit) = joint.limit.filter(|l| l.force(q[coords + i], qd[dofs + i]) != 0.0) {
                self.pose[dofs + i] -= limit.stiffness * own;
                self.speed[dofs + i] -= limit.damping * own;
            }
        }
        self.numbers(robot, &stage.state, by_stage);
        if robot.floating() {
            let spun = Quaternion::from_imag(vector(qd)) * raw_quaternion(&by_rate[3..]) * -0.5;
            by_stage[3..7].iter_mut().zip(spun.coords.iter()).for_each(|(b, s)| *b += s);
        }
    }

    /// Writes the row's gradients with respect to the numbers of a state `[q, qd]`, with a quaternion of any norm.
    fn numbers(&self, robot: &Robot, state: &[f64], out: &mut [f64]) {
        let dofs = robot.root_dofs();
        let coords = robot.root_coords();
        let nq = robot.nq();
        out[coords..nq].copy_from_slice(&self.pose[dofs..]);
        out[nq..].copy_from_slice(&self.speed);
        if robot.floating() {
            out[..3].copy_from_slice(&self.pose[3..6]);
            out[3..7].copy_from_slice(turned_back(&state[3..], &vector(&self.pose)).coords.as_slice());
        }
    }

    /// Converts `by`, a gradient with respect to the numbers of a state, to the row's gradients.
    fn take_numbers(&mut self, robot: &Robot, state: &[f64], by: &[f64]) {
        let dofs = robot.root_dofs();
        let coords = robot.root_coords();
        let nq = robot.nq();
        self.pose[dofs..].copy_from_slice(&by[coords..nq]);
        self.speed.copy_from_slice(&by[nq..]);
        if robot.floating() {
            let turn = (raw_quaternion(&by[3..]) * raw_quaternion(&state[3..]).conjugate()).imag() * 0.5;
            set(&mut self.pose, [turn, vector(by)]);
        }
    }
}

/// Gradient with respect to the four numbers of a quaternion Q of any norm. `by_turn`: gradient with respect to its
/// rotation t (rotation vector, fixed axes), `t = 2 Im(dQ Q*) / |Q|^2`.
fn turned_back(q: &[f64], by_turn: &Vector3<f64>) -> Quaternion<f64> {
    let q = raw_quaternion(q);
    Quaternion::from_imag(*by_turn) * q * (2.0 / q.norm_squared())
}
