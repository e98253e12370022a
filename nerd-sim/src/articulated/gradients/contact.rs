//! Backward pass over a contact's force in a solved stage, at the virtual motion of an [`Adjoint`].

use nerd_core::dynamics::Adjoint;

use super::super::touch::Contact;
use super::contact_law::ContactLaw;
use super::laws::Place;
use super::numbers::{GRAVITY, MATERIAL, NORMAL, OFFSET};
use super::row::Row;
use super::turn::{Press, TurnLaw};
use crate::prelude::*;
use crate::scene::Meeting;

/// A contact that acts in a solved stage.
pub(super) struct Acting<'a> {
    pub(super) place: Place<'a>,
    pub(super) contact: &'a Contact,
    pub(super) law: &'a ContactLaw,
    pub(super) turn: Option<&'a TurnLaw>,
    pub(super) h: f64,
    /// Factor on the gradient that goes on to the stage before, with respect to the wrench held there.
    pub(super) later: f64,
    pub(super) data: &'a Data,
    /// Twist of the contact's link at the substep's start.
    pub(super) start: &'a Motion,
}

/// Gradients with respect to a contact's force, its torque, and the normal force behind the torque.
struct Upstream {
    by_force: Vector3<f64>,
    by_torque: Vector3<f64>,
    by_press: f64,
}

/// Gradients with respect to the inputs of a contact's force, as in [`ContactLaw`]; `along`: to `J qdd`.
struct Inputs {
    along: Vector3<f64>,
    by_velocity: Vector3<f64>,
    by_bend: Vector3<f64>,
    by_gap: f64,
}

/// Gradients with respect to displacements of a contact's point and of its ball's centre.
struct Moved {
    by_place: Vector3<f64>,
    by_middle: Vector3<f64>,
}

impl Acting<'_> {
    /// Backward pass over the contact's wrench on its link. Returns the gradient with respect to the root's `w x v`.
    pub(super) fn back(&self, adjoint: &mut Adjoint, row: &mut Row) -> Vector3<f64> {
        let up = self.upstream(adjoint, row);
        let inputs = self.inputs(&up);
        self.back_to_held(&up, row);
        self.back_to_weights(&up, row);
        if let Some(turn) = self.turn {
            self.back_through_torque(turn, &up, adjoint, row);
        }
        let moved = self.back_through_force(&inputs, adjoint, row);
        if row.numbers.asked() {
            self.back_to_numbers(&up, &inputs, &moved, row);
        }
        inputs.along - inputs.by_bend
    }

    /// The normal force at the substep's start, if the torque depends on it, not on the stage's.
    fn then(&self) -> Option<&Press> {
        self.turn.and_then(|turn| turn.then.as_ref())
    }

    fn upstream(&self, adjoint: &Adjoint, row: &Row) -> Upstream {
        let own = adjoint.virtuals[self.contact.link];
        let held = row.held[self.contact.index];
        let by_torque = own.ang + held.ang;
        // A torque depends on the normal force, hence on all inputs of that force.
        let by_press = self.turn.map_or(0.0, |turn| turn.by_press.dot(&by_torque));
        let at = own.at(&self.contact.x);
        let by_force = held.lin + if self.then().is_some() { at } else { at + self.contact.normal * by_press };
        Upstream { by_force, by_torque, by_press }
    }

    fn inputs(&self, up: &Upstream) -> Inputs {
        let law = self.law;
        let [by_change, mut by_velocity, by_bend] =
            [law.by_change, law.by_velocity, law.by_bend].map(|gradient| gradient.tr_mul(&up.by_force));
        let mut by_gap = law.by_gap.dot(&up.by_force);
        if let Some(then) = self.then() {
            by_gap += then.by_gap * up.by_press;
            by_velocity += self.contact.normal * (then.by_vn * up.by_press);
        }
        Inputs { along: by_change * self.h, by_velocity, by_bend, by_gap }
    }

    /// Adds to the gradients with respect to the wrenches held now and at the substep's start.
    fn back_to_held(&self, up: &Upstream, row: &mut Row) {
        let holds = &mut row.holds[self.contact.index];
        let begun = &mut row.begun[self.contact.index];
        holds.lin += self.law.by_held.tr_mul(&up.by_force) * self.later;
        begun.lin += self.law.by_begun.tr_mul(&up.by_force);
        if let Some(turn) = self.turn {
            holds.ang += turn.by_held.tr_mul(&up.by_torque) * self.later;
            begun.ang += turn.by_begun.tr_mul(&up.by_torque);
        }
    }

    /// Adds to the gradients with respect to the contact's w, along and across the normal.
    fn back_to_weights(&self, up: &Upstream, row: &mut Row) {
        let mut by_across = self.law.by_across.dot(&up.by_force);
        if let Some(turn) = self.turn {
            by_across += turn.by_across.dot(&up.by_torque);
        }
        row.weights[self.contact.index] += self.law.by_weight.dot(&up.by_force) - by_across;
        row.across[self.contact.index] += by_across;
    }

    fn back_through_torque(&self, turn: &TurnLaw, up: &Upstream, adjoint: &mut Adjoint, row: &mut Row) {
        let i = self.contact.link;
        let by =
            |gradient: &Matrix3<f64>, size: f64| Wrench::new(gradient.tr_mul(&up.by_torque) * size, Vector3::zeros());
        adjoint.by_virtual[i].ang += turn.torque;
        adjoint.by_quickened[i] += by(&turn.by_change, self.h);
        row.starts[i] += by(&turn.by_spin, 1.0);
    }

    fn back_through_force(&self, inputs: &Inputs, adjoint: &mut Adjoint, row: &mut Row) -> Moved {
        let Inputs { along, by_velocity, by_bend, by_gap } = *inputs;
        let i = self.contact.link;
        let x = &self.contact.x;
        let n = &self.contact.normal;
        let twist = &self.data.velocity[i];
        row.way += n * by_gap;
        // The place moves with the centre of its ball; `J_dot qd` has the term w x (velocity of the centre).
        let middle = self.middle();
        let by_moves = by_bend.cross(&twist.ang);
        adjoint.by_virtual[i] += Wrench::force_at(self.law.force, x);
        adjoint.by_quickened[i] += Wrench::force_at(along, x);
        adjoint.by_acceleration[i] += Wrench::force_at(by_bend, x);
        adjoint.by_velocity[i] += Wrench::force_at(by_moves, &middle);
        adjoint.by_velocity[i].ang += twist.at(&middle).cross(&by_bend);
        row.starts[i] += Wrench::force_at(by_velocity, x);
        let of = [
            (self.law.force, &adjoint.virtuals[i]),
            (along, &adjoint.quickened[i]),
            (by_velocity, self.start),
            (by_bend, &self.data.acceleration[i]),
        ];
        let by_place = of.iter().fold(n * by_gap, |sum, (by, motion)| sum + by.cross(&motion.ang));
        let by_middle = by_place + by_moves.cross(&twist.ang);
        row.loads[i] += Wrench::force_at(by_middle, &middle);
        Moved { by_place, by_middle }
    }

    fn radius(&self) -> f64 {
        self.place.system.robot.contact_points[self.contact.point].radius
    }

    /// Centre of the point's ball.
    fn middle(&self) -> Vector3<f64> {
        self.contact.x + self.contact.normal * self.radius()
    }

    /// Adds to the gradients with respect to the numbers of robot and scene.
    fn back_to_numbers(&self, up: &Upstream, inputs: &Inputs, moved: &Moved, row: &mut Row) {
        let robot = &self.place.system.robot;
        let n = &self.contact.normal;
        let collider = self.contact.index % self.place.scene.colliders.len();
        let by_gap = inputs.by_gap;
        let Moved { by_place, by_middle } = moved;
        if let Some(turn) = self.turn {
            let link = self.contact.link;
            row.numbers.gyration(&robot.links[link], link, turn.by_gyration.dot(&up.by_torque));
        }
        row.numbers.add(MATERIAL, collider, self.by_material(up, by_gap, collider));
        row.numbers.add(GRAVITY, 0, inputs.by_bend.into());
        let by_normal = self.by_turned(up, row) + (self.middle() + self.data.origin) * by_gap
            - (by_place - n * by_gap) * self.radius();
        row.numbers.add(NORMAL, collider, by_normal.into());
        row.numbers.add(OFFSET, collider, [-by_gap]);
        let by_point = self.data.rotation[self.contact.link].tr_mul(by_middle);
        row.numbers.point(robot, self.contact.point, by_point, -n.dot(by_place));
    }

    /// Gradient with respect to the normal where it splits vectors.
    fn by_turned(&self, up: &Upstream, row: &Row) -> Vector3<f64> {
        let n = &self.contact.normal;
        // Only the part of a force across the normal is held.
        let mut by_turned =
            self.law.by_normal.tr_mul(&up.by_force) - row.held[self.contact.index].lin * n.dot(&self.law.force);
        if let Some(turn) = self.turn {
            by_turned += turn.by_normal.tr_mul(&up.by_torque);
            by_turned += match &turn.then {
                Some(then) => self.contact.velocity * (then.by_vn * up.by_press),
                None => self.law.force * up.by_press,
            };
        }
        by_turned
    }

    /// Gradient with respect to the numbers of the robot's material.
    fn by_material(&self, up: &Upstream, by_gap: f64, collider: usize) -> [f64; 7] {
        let Place { system, scene, .. } = self.place;
        let mut by_material = [0.0; 7];
        by_material.iter_mut().zip(&self.law.by_material).for_each(|(own, by)| *own = by.dot(&up.by_force));
        by_material[6] = -by_gap;
        if let Some(turn) = self.turn {
            [4, 5].into_iter().zip(&turn.by_arms).for_each(|(k, by)| by_material[k] = by.dot(&up.by_torque));
            if let Some(then) = &turn.then {
                by_material.iter_mut().zip(then.by_material).for_each(|(own, by)| *own += by * up.by_press);
            }
        }
        let point = &system.robot.contact_points[self.contact.point];
        if let Some(Meeting::Law(pair)) = system.surfaces.meeting(point, &scene.colliders[collider]) {
            // The pair's law is constant: its material is a multiple of the robot's. The pair's friction has a gradient
            // only where one value is set for all pairs.
            let one = f64::from(system.one_friction.is_some() && pair.condim > 1);
            let factors = [pair.factors[0], pair.factors[1], 1.0, one, 0.0, 0.0, 0.0];
            by_material.iter_mut().zip(factors).for_each(|(by, own)| *by *= own);
        }
        by_material
    }
}
