//! Back over the weights `w = y^T M^-1 y` of touches and joints, by which is chosen how far ahead each force looks.

use nerd_core::dynamics::onto;

use super::super::touch::{Contact, Touch};
use super::numbers::{ARMATURE, DAMPING, NORMAL};
use super::{super::implicit::Damped, super::kept::Step, super::memory::Memory, super::workspace::Workspace, row::Row, stage::Place};
use crate::prelude::*;

/// What is pushed to find a weight.
enum Pushed<'a> {
    Contact(&'a Contact),
    Joint(usize),
}

impl Workspace {
    /// Back over the weights that were found in a substep: those of touches that no substep `before` knew, and those of joints, unless the
    /// substep before was as long.
    pub(super) fn back_weights(&mut self, place: Place, step: &Step, before: &[Step], rows: &mut [Row], memory: &mut Memory) {
        let (robot, h) = (&place.system.robot, step.h);
        let mut factored = None;
        let mut factor = |own: &mut Self| *factored.get_or_insert_with(|| own.factor.refill(&own.data.mass));
        for touch in &step.touches {
            let pushed = match touch {
                Touch::Contact(contact) => Pushed::Contact(contact),
                Touch::Limit(spring) | Touch::Drive { spring, .. } => Pushed::Joint(spring.joint),
                Touch::Friction(_) => continue,
            };
            let Some(index) = touch.index() else { continue };
            let known = || before.iter().flat_map(|step| &step.touches).any(|touch| touch.index() == Some(index));
            if rows.iter().all(|row| row.weights[index] == 0.0) || known() || !factor(self) {
                continue;
            }
            let eased = self.push(robot, &pushed);
            for row in rows.iter_mut() {
                let by = std::mem::take(&mut row.weights[index]);
                self.push_back(place, &pushed, &eased, by, row, memory);
            }
        }
        if before.last().is_some_and(|last| last.h == h) {
            return;
        }
        for (i, joint) in robot.joints().enumerate() {
            let mut w = 0.0;
            if Damped::weighed(joint, h, self.stiff.bounds.least[i]) && factor(self) {
                let eased = self.push(robot, &Pushed::Joint(i));
                w = eased[robot.root_dofs() + i];
                let [(by_braked, by_share), _] = Damped::slopes(joint, h, w);
                for row in rows.iter_mut() {
                    let by = by_braked * row.braked[i] + by_share * row.shares[i];
                    self.push_back(place, &Pushed::Joint(i), &eased, by, row, memory);
                }
            }
            let [_, (by_braked, by_share)] = Damped::slopes(joint, h, w);
            for row in rows.iter_mut() {
                row.numbers.add(DAMPING, i, [by_braked * row.braked[i] + by_share * row.shares[i]]);
                (row.braked[i], row.shares[i]) = (0.0, 0.0);
            }
        }
    }

    /// `M^-1 y`.
    fn push(&self, robot: &Robot, pushed: &Pushed) -> Vec<f64> {
        let mut out = vec![0.0; robot.nv()];
        match pushed {
            Pushed::Joint(joint) => out[robot.root_dofs() + joint] = 1.0,
            Pushed::Contact(contact) => {
                let mut wrenches = vec![Wrench::default(); robot.links.len()];
                wrenches[contact.link] = Wrench::force_at(contact.normal, &contact.x);
                onto(robot, &self.data, &mut wrenches, &mut out);
            }
        }
        self.factor.solve(&mut out);
        out
    }

    /// `dw = 2 z . dy - z . dM z` with `z = M^-1 y`.
    fn push_back(&self, place: Place, pushed: &Pushed, eased: &[f64], by: f64, row: &mut Row, memory: &mut Memory) {
        let (robot, colliders) = (&place.system.robot, place.scene.colliders.len());
        let adjoint = &mut memory.adjoint;
        adjoint.begin_energy(robot, &self.data, eased, -by, &mut row.loads);
        if let Pushed::Contact(contact) = pushed {
            let (i, n, radius) = (contact.link, contact.normal * (2.0 * by), robot.contact_points[contact.point].radius);
            let by_place = n.cross(&adjoint.virtuals[i].ang);
            adjoint.by_virtual[i] += Wrench::force_at(n, &contact.x);
            row.loads[i] += Wrench::force_at(by_place, &(contact.x + contact.normal * radius));
            if row.numbers.asked() {
                let collider = contact.index % colliders;
                let by_normal = adjoint.virtuals[i].at(&contact.x) * (2.0 * by) - by_place * radius;
                row.numbers.add(NORMAL, collider, by_normal.into());
                row.numbers.point(robot, contact.point, self.data.rotation[i].tr_mul(&by_place), -contact.normal.dot(&by_place));
            }
        }
        for i in 0..if row.numbers.asked() { robot.links.len() } else { 0 } {
            row.numbers.inertia(robot, &self.data, i, -by, [&adjoint.virtuals[i]; 2]);
        }
        for (i, z) in eased[robot.root_dofs()..].iter().enumerate() {
            row.numbers.add(ARMATURE, i, [-by * z * z]);
        }
        adjoint.end_energy(robot, &self.data, eased, &mut row.loads);
    }
}
