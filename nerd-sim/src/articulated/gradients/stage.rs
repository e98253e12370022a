//! Backward pass over the solves of an implicit substep with one middle velocity, by the implicit function theorem.

use nalgebra::{DMatrix, DVector, Dyn, LU};
use nerd_core::dynamics::{bias, motions};

use super::super::kept::{Stage, Step};
use super::super::spin::{SPIN_PASSES, Spin};
use super::super::stick::HELD_FACTOR;
use super::super::touch::Touch;
use super::super::{find::above, memory::Memory, press::turns, workspace::Workspace};
use super::contact::Acting;
use super::laws::{Law, Place};
use super::numbers::{ARMATURE, FRICTION, GRAVITY};
use super::row::{Row, set};
use crate::prelude::*;

/// Relative remainder of the gradient at which the iteration for the middle angular velocity ends.
const SETTLED: f64 = 1e-13;

/// A solved stage, as input of its backward pass.
struct Solved<'a> {
    place: Place<'a>,
    step: &'a Step,
    stage: &'a Stage,
    laws: &'a [Law],
    qdd: &'a [f64],
    solver: &'a LU<f64, Dyn, Dyn>,
    data: &'a Data,
}

impl Solved<'_> {
    /// Backward pass over its solve, from the row's gradient `rate` to all inputs except the middle velocity.
    /// `by_middle` becomes the gradient with respect to the middle velocity.
    fn back(&self, row: &mut Row, memory: &mut Memory) {
        let Self { place, data, qdd, .. } = *self;
        let robot = &place.system.robot;
        // The root's w x v is a part of the rate; the held wrenches follow from the spatial acceleration alone.
        let by_turn = if robot.floating() { vector(&row.rate[3..]) } else { Vector3::zeros() };
        self.back_from_held(row, &mut memory.columns);
        let virtuals = self.virtuals(row);
        let virtuals = virtuals.as_slice();
        memory.by_middle.fill(0.0);
        memory.adjoint.begin(robot, data, (virtuals, qdd), &place.scene.gravity, &mut row.loads);
        row.inertias(robot, data, &memory.adjoint);
        self.back_through_joints(virtuals, row);
        let by_turn = self.back_through_touches(virtuals, by_turn, row, memory);
        self.back_to_middle(virtuals, &by_turn, row, memory);
    }

    /// Adds to `rate` the gradient through wrenches held by later stages, which depend on this solution.
    fn back_from_held(&self, row: &mut Row, columns: &mut Vec<(usize, Vector3<f64>)>) {
        let Self { data, step: Step { h, .. }, .. } = *self;
        let robot = &self.place.system.robot;
        for law in self.laws {
            let Law::Contact(contact, law, turn) = law else { continue };
            let mut by = row.held[contact.index].lin;
            if let Some(turn) = turn {
                let own = row.held[contact.index].ang;
                if turn.then.is_none() {
                    by += contact.normal * turn.by_press.dot(&own);
                }
                let own = turn.by_change.tr_mul(&own) * *h;
                turns(robot, (&data.dof, &data.axis), contact.link).for_each(|(k, a)| row.rate[k] += a.dot(&own));
            }
            let by = law.by_change.tr_mul(&by) * *h;
            columns.clear();
            above(robot, data, contact.link, &contact.x, columns);
            columns.drain(..).for_each(|(k, a)| row.rate[k] += a.dot(&by));
        }
    }

    /// Solves for the virtual velocities of the gradient `rate`.
    fn virtuals(&self, row: &Row) -> DVector<f64> {
        let mut virtuals = DVector::from_column_slice(&row.rate);
        if !self.solver.solve_mut(&mut virtuals) {
            // NaN marks a singular system in all gradients.
            virtuals.fill(f64::NAN);
        }
        virtuals
    }

    /// Backward pass over torques, springs, damping and implicit resistance of the joints.
    fn back_through_joints(&self, virtuals: &[f64], row: &mut Row) {
        let Self { step, qdd, .. } = *self;
        let robot = &self.place.system.robot;
        let dofs = robot.root_dofs();
        for (i, joint) in robot.joints().enumerate() {
            let own = virtuals[dofs + i];
            row.torque[i] += own;
            row.pose[dofs + i] -= joint.stiffness * own;
            row.speed[dofs + i] -= step.damping_used[i] * own;
            row.damping_used[i] -= step.qd[dofs + i] * own;
            row.shares[i] -= qdd[dofs + i] * own;
            row.numbers.add(ARMATURE, i, [-qdd[dofs + i] * own]);
        }
    }

    /// Backward pass over the forces of touches. Adds theirs to `by_turn`, the gradient with respect to the root's
    /// `w x v`, and returns it.
    fn back_through_touches(
        &self,
        virtuals: &[f64],
        mut by_turn: Vector3<f64>,
        row: &mut Row,
        memory: &mut Memory,
    ) -> Vector3<f64> {
        let Self { place, data, .. } = *self;
        let h = self.step.h;
        let later = if self.stage.again { HELD_FACTOR } else { 1.0 };
        let dofs = place.system.robot.root_dofs();
        for law in self.laws {
            match law {
                Law::Contact(contact, law, turn) => {
                    let turn = turn.as_ref();
                    let start = &memory.starts[contact.link];
                    let acting = Acting { place, contact, law, turn, h, later, data, start };
                    by_turn += acting.back(&mut memory.adjoint, row);
                }
                Law::Joint(joint, weight, law) => {
                    let own = virtuals[dofs + joint];
                    row.pose[dofs + joint] += law.by_gap * own;
                    row.speed[dofs + joint] += law.by_rate * own;
                    weight.iter().for_each(|weight| row.weights[*weight] += law.by_weight * own);
                    row.numbers.add(FRICTION, *joint, [law.by_most * own]);
                }
                Law::Drive(joint, weight, law) => {
                    let own = virtuals[dofs + joint];
                    let by = [law.by_gap * own, law.by_rate * own];
                    row.pose[dofs + joint] += by[0];
                    row.speed[dofs + joint] += by[1];
                    row.weights[*weight] += law.by_weight * own;
                    row.drives[*joint].iter_mut().zip(by).for_each(|(sum, by)| *sum -= by);
                }
            }
        }
        by_turn
    }

    /// Ends the backward pass over the dynamics, with the gradient with respect to the middle velocity.
    fn back_to_middle(&self, virtuals: &[f64], by_turn: &Vector3<f64>, row: &mut Row, memory: &mut Memory) {
        let Self { data, stage, qdd, .. } = *self;
        let robot = &self.place.system.robot;
        let Memory { adjoint, by_middle, .. } = memory;
        let by_base = adjoint.end(robot, data, (virtuals, &stage.middle, qdd), &mut row.loads, by_middle);
        row.numbers.add(GRAVITY, 0, (-by_base).into());
        if robot.floating() {
            let [w, v, by_w, by_v] = [&stage.middle, &stage.middle[3..], by_middle, &by_middle[3..]].map(vector);
            set(by_middle, [by_w + v.cross(by_turn), by_v + by_turn.cross(&w)]);
        }
        row.speed.iter_mut().zip(by_middle.iter()).for_each(|(s, m)| *s += m);
    }

    /// Takes a row's gradient `rate` from this stage's rate to the substep's inputs and the rate of the stage before.
    /// `spins`: how the middle angular velocity was found from this stage's own rate.
    fn back_row(&self, spins: Option<&Spin>, row: &mut Row, memory: &mut Memory) {
        let h = self.step.h;
        // The gradient of a held wrench goes on to the stage before, if its contact does not act in this substep.
        row.holds.copy_from_slice(&row.held);
        self.step.touches.iter().filter_map(Touch::index).for_each(|index| row.holds[index] = Motion::default());
        self.back(row, memory);
        let mut by_rate = memory.by_middle.clone();
        row.held.fill(Motion::default());
        if let Some(spins) = spins {
            self.back_to_own_rate(spins, &mut by_rate, row, memory);
        }
        row.rate.iter_mut().zip(&by_rate).for_each(|(r, m)| *r = 0.5 * h * m);
        std::mem::swap(&mut row.held, &mut row.holds);
    }

    /// The middle angular velocity depends on this stage's own rate. So the remainder of the gradient with respect to
    /// that velocity goes back to the rate, until the remainder vanishes.
    fn back_to_own_rate(&self, spins: &Spin, by_rate: &mut [f64], row: &mut Row, memory: &mut Memory) {
        let h = self.step.h;
        let mut off = vector(&memory.by_middle) * (0.5 * h);
        let least = SETTLED * off.norm();
        for _ in 0..SPIN_PASSES {
            let more = spins.back(&self.stage.middle, &off);
            row.rate.fill(0.0);
            row.rate[..3].copy_from_slice(more.as_slice());
            self.back(row, memory);
            by_rate.iter_mut().zip(memory.by_middle.iter()).for_each(|(sum, by)| *sum += by);
            off += vector(&memory.by_middle) * (0.5 * h) - more;
            if off.norm() <= least {
                break;
            }
        }
        by_rate[..3].fill(0.0);
    }
}

impl Workspace {
    /// Takes the rows' gradients `rate` from this stage's rate to the substep's inputs and the rate of the stage
    /// before. Needs kinematics and mass matrix at the substep's middle.
    pub(super) fn back_stage(
        &mut self,
        place: Place,
        step: &Step,
        stage: &Stage,
        rows: &mut [Row],
        memory: &mut Memory,
    ) {
        let robot = &place.system.robot;
        bias(robot, &stage.middle, &place.scene.gravity, &mut self.data);
        let mut qdd = stage.rate.clone();
        let mut turn = Vector3::zeros();
        if robot.floating() {
            turn = vector(&stage.middle).cross(&vector(&stage.middle[3..]));
            (0..3).for_each(|k| qdd[3 + k] -= turn[k]);
        }
        motions(robot, &qdd, &self.data, &mut memory.quickened);
        let laws = self.laws(place, step, stage, (&qdd, &turn), &memory.quickened);
        let data = &self.data;
        let solver = transposed(robot, data, step, &laws, memory).lu();
        let spins = Spin::of(robot, data, (step.h, SETTLED), &step.qd).filter(|_| stage.spun);
        let solved = Solved { place, step, stage, laws: &laws, qdd: &qdd, solver: &solver, data };
        rows.iter_mut().for_each(|row| solved.back_row(spins.as_ref(), row, memory));
    }
}

/// `(dR/da)^T`, see [`Memory`].
fn transposed(robot: &Robot, data: &Data, step: &Step, laws: &[Law], memory: &mut Memory) -> DMatrix<f64> {
    let Memory { matrix, columns, .. } = memory;
    let dofs = robot.root_dofs();
    matrix.copy_from(&data.mass);
    step.shares.iter().enumerate().for_each(|(i, share)| matrix[(dofs + i, dofs + i)] += share);
    laws.iter().for_each(|law| law.resist(robot, data, step.h, columns, matrix));
    matrix.clone()
}
