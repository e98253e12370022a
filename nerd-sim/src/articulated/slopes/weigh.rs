//! Back over the weights `w = y^T M^-1 y` of touches and joints, by which is chosen how far ahead each force looks.

use nerd_core::dynamics::onto;
use nerd_core::robot::Robot;
use nerd_core::spatial::Wrench;

use super::super::implicit::Damped;
use super::super::touch::{Contact, Touch};
use super::super::workspace::Workspace;
use super::kept::Step;
use super::row::Row;
use super::stage::{Memory, Place};

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
                self.push_back(robot, &pushed, &eased, by, row, memory);
            }
        }
        if before.last().is_some_and(|last| last.h == h) {
            return;
        }
        for (i, joint) in robot.joints().enumerate() {
            if Damped::weighed(joint, h, self.stiff.bounds.least[i]) && factor(self) {
                let eased = self.push(robot, &Pushed::Joint(i));
                let [by_braked, by_share] = Damped::slopes(joint, h, eased[robot.root_dofs() + i]);
                for row in rows.iter_mut() {
                    let by = by_braked * row.braked[i] + by_share * row.shares[i];
                    self.push_back(robot, &Pushed::Joint(i), &eased, by, row, memory);
                }
            }
            rows.iter_mut().for_each(|row| (row.braked[i], row.shares[i]) = (0.0, 0.0));
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
    fn push_back(&self, robot: &Robot, pushed: &Pushed, eased: &[f64], by: f64, row: &mut Row, memory: &mut Memory) {
        let adjoint = &mut memory.adjoint;
        adjoint.begin_energy(robot, &self.data, eased, -by, &mut row.loads);
        if let Pushed::Contact(contact) = pushed {
            let (i, n) = (contact.link, contact.normal * (2.0 * by));
            let middle = contact.x + contact.normal * robot.contact_points[contact.point].radius;
            adjoint.by_virtual[i] += Wrench::force_at(n, &contact.x);
            row.loads[i] += Wrench::force_at(n.cross(&adjoint.virtuals[i].ang), &middle);
        }
        adjoint.end_energy(robot, &self.data, eased, &mut row.loads);
    }
}
