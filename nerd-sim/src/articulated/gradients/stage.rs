//! Backward pass over the solves of an implicit substep with one middle velocity, by the implicit function theorem.

use nalgebra::{DVector, Dyn, LU};
use nerd_core::dynamics::{Adjoint, bias, motions};

use super::super::kept::{Stage, Step};
use super::super::spin::{SPIN_PASSES, Spin};
use super::super::stick::HELD_FACTOR;
use super::super::touch::{Contact, Touch};
use super::law::{At, ContactLaw, JointLaw};
use super::numbers::{ARMATURE, FRICTION, GRAVITY, MATERIAL, NORMAL, OFFSET};
use super::row::{Row, set};
use super::turn::TurnLaw;
use super::{super::find::above, super::kick::turns, super::memory::Memory, super::workspace::Workspace};
use crate::prelude::*;
use crate::scene::Meeting;

/// Relative remainder of the gradient at which the iteration for the middle angular velocity ends.
const SETTLED: f64 = 1e-13;

/// A force that acts in a stage, with the derivatives of its law.
#[allow(clippy::large_enum_variant)] // Most are contacts.
enum Law {
    Contact(Contact, ContactLaw, Option<TurnLaw>),
    /// Limit or dry friction of a joint, the index of its w (none for dry friction), and its law.
    Joint(usize, Option<usize>, JointLaw),
    /// Drive of a joint, the index of its w, and its law.
    Drive(usize, usize, JointLaw),
}

/// A solved stage, as input of its backward pass.
struct Solved<'a> {
    place: Place<'a>,
    step: &'a Step,
    stage: &'a Stage,
    laws: &'a [Law],
    qdd: &'a [f64],
    solver: &'a LU<f64, Dyn, Dyn>,
    data: &'a Data,
    starts: &'a [Motion],
}

impl Solved<'_> {
    /// Backward pass over its solve, from the row's gradient `rate` to all inputs except the middle velocity.
    /// `by_middle` becomes the gradient with respect to the middle velocity.
    fn back(
        &self,
        row: &mut Row,
        adjoint: &mut Adjoint,
        columns: &mut Vec<(usize, Vector3<f64>)>,
        by_middle: &mut [f64],
    ) {
        let Self { place, step, stage, laws, qdd, solver, data, starts } = *self;
        let (robot, h) = (&place.system.robot, step.h);
        let dofs = robot.root_dofs();
        // The root's w x v is a part of the rate; the held wrenches follow from the spatial acceleration alone.
        let mut by_turn = if robot.floating() { vector(&row.rate[3..]) } else { Vector3::zeros() };
        // Forces held by later stages depend on this solution.
        for law in laws {
            let Law::Contact(contact, law, turn) = law else { continue };
            let mut by = row.held[contact.index].lin;
            if let Some(turn) = turn {
                let own = row.held[contact.index].ang;
                if turn.then.is_none() {
                    by += contact.normal * turn.by_press.dot(&own);
                }
                let own = turn.by_change.tr_mul(&own) * h;
                turns(robot, (&data.dof, &data.axis), contact.link).for_each(|(k, a)| row.rate[k] += a.dot(&own));
            }
            let by = law.by_change.tr_mul(&by) * h;
            columns.clear();
            above(robot, data, contact.link, &contact.x, columns);
            columns.drain(..).for_each(|(k, a)| row.rate[k] += a.dot(&by));
        }
        let mut virtuals = DVector::from_column_slice(&row.rate);
        if !solver.solve_mut(&mut virtuals) {
            // NaN marks a singular system in all gradients.
            virtuals.fill(f64::NAN);
        }
        let virtuals = virtuals.as_slice();
        by_middle.fill(0.0);
        adjoint.begin(robot, data, (virtuals, qdd), &place.scene.gravity, &mut row.loads);
        row.inertias(robot, data, adjoint);
        for (i, joint) in robot.joints().enumerate() {
            let own = virtuals[dofs + i];
            row.torque[i] += own;
            row.pose[dofs + i] -= joint.stiffness * own;
            row.speed[dofs + i] -= step.damping_used[i] * own;
            row.damping_used[i] -= step.qd[dofs + i] * own;
            row.shares[i] -= qdd[dofs + i] * own;
            row.numbers.add(ARMATURE, i, [-qdd[dofs + i] * own]);
        }
        for law in laws {
            match law {
                Law::Contact(contact, law, turn) => {
                    let later = if stage.again { HELD_FACTOR } else { 1.0 };
                    by_turn +=
                        solve_adjoint(place, contact, (law, turn.as_ref()), (h, later), data, starts, adjoint, row);
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
        let by_base = adjoint.end(robot, data, (virtuals, &stage.middle, qdd), &mut row.loads, by_middle);
        row.numbers.add(GRAVITY, 0, (-by_base).into());
        if robot.floating() {
            let [w, v, by_w, by_v] = [&stage.middle, &stage.middle[3..], by_middle, &by_middle[3..]].map(vector);
            set(by_middle, [by_w + v.cross(&by_turn), by_v + by_turn.cross(&w)]);
        }
        row.speed.iter_mut().zip(by_middle.iter()).for_each(|(s, m)| *s += m);
    }
}

/// System, scene and friction law of the frame.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) system: &'a System,
    pub(super) scene: &'a Scene,
    pub(super) friction: Friction,
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
        let (robot, h) = (&place.system.robot, step.h);
        let dofs = robot.root_dofs();
        bias(robot, &stage.middle, &place.scene.gravity, &mut self.data);
        let (mut qdd, mut turn) = (stage.rate.clone(), Vector3::zeros());
        if robot.floating() {
            turn = vector(&stage.middle).cross(&vector(&stage.middle[3..]));
            (0..3).for_each(|k| qdd[3 + k] -= turn[k]);
        }
        motions(robot, &qdd, &self.data, &mut memory.quickened);
        let laws = self.laws(place, step, stage, (&qdd, &turn), &memory.quickened);
        let Memory { adjoint, starts, columns, by_middle, matrix, .. } = memory;
        let data = &self.data;
        matrix.copy_from(&data.mass);
        step.shares.iter().enumerate().for_each(|(i, share)| matrix[(dofs + i, dofs + i)] += share);
        for law in &laws {
            match law {
                Law::Contact(contact, law, turn) => {
                    columns.clear();
                    above(robot, data, contact.link, &contact.x, columns);
                    for (i, a) in columns.iter() {
                        let along = law.by_change.tr_mul(a) * h;
                        columns.iter().for_each(|(j, b)| matrix[(*j, *i)] -= along.dot(b));
                    }
                    let Some(turn) = turn else { continue };
                    for (i, a) in turns(robot, (&data.dof, &data.axis), contact.link) {
                        let along = turn.by_change.tr_mul(&a) * h;
                        turns(robot, (&data.dof, &data.axis), contact.link)
                            .for_each(|(j, b)| matrix[(j, i)] -= along.dot(&b));
                        if turn.then.is_none() {
                            let along = law.by_change.tr_mul(&contact.normal) * (turn.by_press.dot(&a) * h);
                            columns.iter().for_each(|(j, b)| matrix[(*j, i)] -= along.dot(b));
                        }
                    }
                }
                Law::Joint(joint, _, law) | Law::Drive(joint, _, law) => {
                    matrix[(dofs + joint, dofs + joint)] -= h * law.by_change
                }
            }
        }
        let solver = matrix.clone().lu();
        let spins = Spin::of(robot, data, (h, SETTLED), &step.qd).filter(|_| stage.spun);
        let solved = Solved { place, step, stage, laws: &laws, qdd: &qdd, solver: &solver, data, starts };
        for row in rows {
            // The gradient of a held wrench goes on to the stage before, if its contact does not act in this substep.
            row.holds.copy_from_slice(&row.held);
            step.touches.iter().filter_map(Touch::index).for_each(|index| row.holds[index] = Motion::default());
            solved.back(row, adjoint, columns, by_middle);
            let mut by_rate = by_middle.clone();
            row.held.fill(Motion::default());
            if let Some(spins) = &spins {
                let mut off = vector(by_middle) * (0.5 * h);
                // The middle angular velocity depends on this stage's own rate. So the remainder of the gradient with
                // respect to that velocity goes back to the rate, until the remainder vanishes.
                let least = SETTLED * off.norm();
                for _ in 0..SPIN_PASSES {
                    let more = spins.back(&stage.middle, &off);
                    row.rate.fill(0.0);
                    row.rate[..3].copy_from_slice(more.as_slice());
                    solved.back(row, adjoint, columns, by_middle);
                    by_rate.iter_mut().zip(by_middle.iter()).for_each(|(sum, by)| *sum += by);
                    off += vector(by_middle) * (0.5 * h) - more;
                    if off.norm() <= least {
                        break;
                    }
                }
                by_rate[..3].fill(0.0);
            }
            row.rate.iter_mut().zip(&by_rate).for_each(|(r, m)| *r = 0.5 * h * m);
            std::mem::swap(&mut row.held, &mut row.holds);
        }
    }

    /// Laws of the touches in a stage; needs `bias` at its middle velocity.
    fn laws(
        &self,
        place: Place,
        step: &Step,
        stage: &Stage,
        (qdd, turn): (&[f64], &Vector3<f64>),
        quickened: &[Motion],
    ) -> Vec<Law> {
        let Place { system, scene, friction } = place;
        let (robot, h) = (&system.robot, step.h);
        let weight = |index: usize| self.touches.weights[index].unwrap_or(f64::INFINITY);
        let at = At { h, weight: f64::INFINITY, friction, first: stage.first, mean_theta: self.touches.mean_theta };
        let change = |joint: usize| h * qdd[robot.root_dofs() + joint];
        let law = |(n, touch): (usize, &Touch)| match touch {
            Touch::Contact(contact) => {
                let (at, mut contact) = (At { weight: weight(contact.index), ..at }, contact.clone());
                if let Some(held) = stage.held.get(n) {
                    [contact.slip_offset, contact.turning.turn_offset] = *held;
                }
                contact.bend(&robot.contact_points[contact.point], &self.data, &(scene.gravity - turn), turn, h);
                let law = ContactLaw::of(&contact, &at, &contact.whole, &(quickened[contact.link].at(&contact.x) * h));
                let turn =
                    contact.turns().then(|| TurnLaw::of(&contact, &at, &law, &(quickened[contact.link].ang * h)));
                Law::Contact(contact, law, turn)
            }
            Touch::Limit(spring) => {
                let at = At { weight: weight(spring.index), ..at };
                let whole = robot.joints().nth(spring.joint).and_then(|j| j.limit).map(|l| [l.stiffness, l.damping]);
                Law::Joint(spring.joint, Some(spring.index), JointLaw::spring(spring, &at, whole, change(spring.joint)))
            }
            Touch::Drive { spring, .. } => {
                let at = At { weight: weight(spring.index), ..at };
                Law::Drive(spring.joint, spring.index, JointLaw::spring(spring, &at, None, change(spring.joint)))
            }
            Touch::Friction(dry) => Law::Joint(dry.joint, None, JointLaw::friction(dry, &at, change(dry.joint))),
        };
        step.touches
            .iter()
            .enumerate()
            .zip(&stage.idle)
            .filter(|(_, idle)| !**idle)
            .map(|(touch, _)| law(touch))
            .collect()
    }
}

/// Backward pass over a contact's force on its link, at the virtual motion in `adjoint`. Returns the gradient with
/// respect to the root's `w x v`.
#[allow(clippy::too_many_arguments)]
fn solve_adjoint(
    place: Place,
    contact: &Contact,
    (law, turn): (&ContactLaw, Option<&TurnLaw>),
    (h, later): (f64, f64),
    data: &Data,
    starts: &[Motion],
    adjoint: &mut Adjoint,
    row: &mut Row,
) -> Vector3<f64> {
    let (i, x, n) = (contact.link, &contact.x, &contact.normal);
    let radius = place.system.robot.contact_points[contact.point].radius;
    let (twist, bent) = (&data.velocity[i], &data.acceleration[i]);
    let (own, quickened) = (adjoint.virtuals[i], adjoint.quickened[i]);
    // A torque depends on the normal force, hence on all inputs of that force.
    let held = row.held[contact.index];
    let by_torque = own.ang + held.ang;
    let by_press = turn.map_or(0.0, |turn| turn.by_press.dot(&by_torque));
    let then = turn.and_then(|turn| turn.then.as_ref());
    let by_force = held.lin + if then.is_some() { own.at(x) } else { own.at(x) + n * by_press };
    row.holds[contact.index].lin += law.by_held.tr_mul(&by_force) * later;
    row.begun[contact.index].lin += law.by_begun.tr_mul(&by_force);
    let mut by_across = law.by_across.dot(&by_force);
    let [by_change, mut by_velocity, by_bend] =
        [law.by_change, law.by_velocity, law.by_bend].map(|gradient| gradient.tr_mul(&by_force));
    let (mut by_gap, along) = (law.by_gap.dot(&by_force), by_change * h);
    if let Some(then) = then {
        by_gap += then.by_gap * by_press;
        by_velocity += n * (then.by_vn * by_press);
    }
    if let Some(turn) = turn {
        let by = |gradient: &Matrix3<f64>, size: f64| Wrench::new(gradient.tr_mul(&by_torque) * size, Vector3::zeros());
        row.holds[contact.index].ang += turn.by_held.tr_mul(&by_torque) * later;
        row.begun[contact.index].ang += turn.by_begun.tr_mul(&by_torque);
        by_across += turn.by_across.dot(&by_torque);
        adjoint.by_virtual[i].ang += turn.torque;
        adjoint.by_quickened[i] += by(&turn.by_change, h);
        row.starts[i] += by(&turn.by_spin, 1.0);
    }
    row.weights[contact.index] += law.by_weight.dot(&by_force) - by_across;
    row.across[contact.index] += by_across;
    row.way += n * by_gap;
    // The place moves with the centre of its ball; `J_dot qd` has the term w x (velocity of the centre).
    let middle = x + n * radius;
    let by_moves = by_bend.cross(&twist.ang);
    adjoint.by_virtual[i] += Wrench::force_at(law.force, x);
    adjoint.by_quickened[i] += Wrench::force_at(along, x);
    adjoint.by_acceleration[i] += Wrench::force_at(by_bend, x);
    adjoint.by_velocity[i] += Wrench::force_at(by_moves, &middle);
    adjoint.by_velocity[i].ang += twist.at(&middle).cross(&by_bend);
    row.starts[i] += Wrench::force_at(by_velocity, x);
    let of = [(law.force, &own), (along, &quickened), (by_velocity, &starts[i]), (by_bend, bent)];
    let by_place = of.iter().fold(n * by_gap, |sum, (by, motion)| sum + by.cross(&motion.ang));
    let by_middle = by_place + by_moves.cross(&twist.ang);
    row.loads[i] += Wrench::force_at(by_middle, &middle);
    if row.numbers.asked() {
        let collider = contact.index % place.scene.colliders.len();
        let mut by_material = [0.0; 7];
        by_material.iter_mut().zip(&law.by_material).for_each(|(own, by)| *own = by.dot(&by_force));
        by_material[6] = -by_gap;
        // Only the part of a force across the normal is held.
        let mut by_turned = law.by_normal.tr_mul(&by_force) - held.lin * n.dot(&law.force);
        if let Some(turn) = turn {
            [4, 5].into_iter().zip(&turn.by_arms).for_each(|(k, by)| by_material[k] = by.dot(&by_torque));
            by_turned += turn.by_normal.tr_mul(&by_torque);
            row.numbers.gyration(&place.system.robot.links[i], i, turn.by_gyration.dot(&by_torque));
            match then {
                Some(then) => {
                    by_turned += contact.velocity * (then.by_vn * by_press);
                    by_material.iter_mut().zip(then.by_material).for_each(|(own, by)| *own += by * by_press);
                }
                None => by_turned += law.force * by_press,
            }
        }
        let mets = place
            .system
            .surfaces
            .meeting(&place.system.robot.contact_points[contact.point], &place.scene.colliders[collider]);
        if let Some(Meeting::Law(pair)) = mets {
            // The pair's law is constant: its material is a multiple of the robot's. The pair's friction has a gradient
            // only where one value is set for all pairs.
            let one = f64::from(place.system.one_friction.is_some() && pair.condim > 1);
            by_material
                .iter_mut()
                .zip([pair.factors[0], pair.factors[1], 1.0, one, 0.0, 0.0, 0.0])
                .for_each(|(by, own)| *by *= own);
        }
        row.numbers.add(MATERIAL, collider, by_material);
        row.numbers.add(GRAVITY, 0, by_bend.into());
        let by_normal = by_turned + (middle + data.origin) * by_gap - (by_place - n * by_gap) * radius;
        row.numbers.add(NORMAL, collider, by_normal.into());
        row.numbers.add(OFFSET, collider, [-by_gap]);
        row.numbers.point(&place.system.robot, contact.point, data.rotation[i].tr_mul(&by_middle), -n.dot(&by_place));
    }
    along - by_bend
}
