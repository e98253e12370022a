//! Backward pass over the inverse effective masses `w = y^T M^-1 y` of touches and joints, which set their thetas.

use nerd_core::dynamics::onto;

use super::super::touch::{Contact, Touch};
use super::numbers::{ARMATURE, DAMPING, NORMAL};
use super::{
    super::implicit::Damped, super::kept::Step, super::memory::Memory, super::workspace::Workspace, laws::Place,
    row::Row,
};
use crate::prelude::*;

/// Direction y of an inverse effective mass w: an axis at a contact, or a joint.
enum Pushed<'a> {
    Contact(&'a Contact, Vector3<f64>),
    Joint(usize),
}

impl Workspace {
    /// Backward pass over each w computed in this substep. Those are the w of touches absent in the substeps `before`,
    /// and of joints if the substep before had another length.
    pub(super) fn inv_mass_adjoint(
        &mut self,
        place: Place,
        step: &Step,
        before: &[Step],
        rows: &mut [Row],
        memory: &mut Memory,
    ) {
        let robot = &place.system.robot;
        let h = step.h;
        let mut factored = None;
        let mut factor = |own: &mut Self| *factored.get_or_insert_with(|| own.factor.refill(&own.data.mass));
        for touch in &step.touches {
            let pushed = match touch {
                Touch::Contact(contact) => Pushed::Contact(contact, contact.normal),
                Touch::Limit(spring) | Touch::Drive { spring, .. } => Pushed::Joint(spring.joint),
                Touch::Friction(_) => continue,
            };
            let Some(index) = touch.index() else { continue };
            let known = || before.iter().flat_map(|step| &step.touches).any(|touch| touch.index() == Some(index));
            if rows.iter().all(|row| row.weights[index] == 0.0 && row.across[index] == 0.0) || known() || !factor(self)
            {
                continue;
            }
            let response = self.push(robot, &pushed);
            for row in rows.iter_mut() {
                let by = std::mem::take(&mut row.weights[index]);
                self.push_back(place, &pushed, &response, by, row, memory);
            }
            let Touch::Contact(contact) = touch else { continue };
            for axis in (0..3).map(|k| Vector3::ith(k, 1.0)) {
                let pushed = Pushed::Contact(contact, axis);
                let response = self.push(robot, &pushed);
                rows.iter_mut()
                    .for_each(|row| self.push_back(place, &pushed, &response, row.across[index], row, memory));
            }
            rows.iter_mut().for_each(|row| row.across[index] = 0.0);
        }
        if before.last().is_some_and(|last| last.h == h) {
            return;
        }
        for (i, joint) in robot.joints().enumerate() {
            let mut w = 0.0;
            if Damped::needs_inv_mass(joint, h, self.stiff.bounds.least[i]) && factor(self) {
                let response = self.push(robot, &Pushed::Joint(i));
                w = response[robot.root_dofs() + i];
                let [(by_damping_used, by_share), _] = Damped::gradients(joint, h, w);
                for row in rows.iter_mut() {
                    let by = by_damping_used * row.damping_used[i] + by_share * row.shares[i];
                    self.push_back(place, &Pushed::Joint(i), &response, by, row, memory);
                }
            }
            let [_, (by_damping_used, by_share)] = Damped::gradients(joint, h, w);
            for row in rows.iter_mut() {
                row.numbers.add(DAMPING, i, [by_damping_used * row.damping_used[i] + by_share * row.shares[i]]);
                (row.damping_used[i], row.shares[i]) = (0.0, 0.0);
            }
        }
    }

    /// `M^-1 y` for a direction y.
    fn push(&self, robot: &Robot, pushed: &Pushed) -> Vec<f64> {
        let mut out = vec![0.0; robot.nv()];
        match pushed {
            Pushed::Joint(joint) => out[robot.root_dofs() + joint] = 1.0,
            Pushed::Contact(contact, along) => {
                let mut wrenches = vec![Wrench::default(); robot.links.len()];
                wrenches[contact.link] = Wrench::force_at(*along, &contact.x);
                onto(robot, &self.data, &mut wrenches, &mut out);
            }
        }
        self.factor.solve(&mut out);
        out
    }

    /// Adds `by` times the gradient of one w: `dw = 2 z . dy - z . dM z` with `z = M^-1 y` (`response`).
    fn push_back(&self, place: Place, pushed: &Pushed, response: &[f64], by: f64, row: &mut Row, memory: &mut Memory) {
        let robot = &place.system.robot;
        let colliders = place.scene.colliders.len();
        let adjoint = &mut memory.adjoint;
        adjoint.begin_energy(robot, &self.data, response, -by, &mut row.loads);
        if let Pushed::Contact(contact, along) = pushed {
            let i = contact.link;
            let n = along * (2.0 * by);
            let radius = robot.contact_points[contact.point].radius;
            let by_place = n.cross(&adjoint.virtuals[i].ang);
            adjoint.by_virtual[i] += Wrench::force_at(n, &contact.x);
            row.loads[i] += Wrench::force_at(by_place, &(contact.x + contact.normal * radius));
            if row.numbers.asked() {
                let collider = contact.index % colliders;
                // The fixed axes of w across the normal do not turn with the normal.
                let turned = if *along == contact.normal {
                    adjoint.virtuals[i].at(&contact.x) * (2.0 * by)
                } else {
                    Vector3::zeros()
                };
                let by_normal = turned - by_place * radius;
                row.numbers.add(NORMAL, collider, by_normal.into());
                row.numbers.point(
                    robot,
                    contact.point,
                    self.data.rotation[i].tr_mul(&by_place),
                    -contact.normal.dot(&by_place),
                );
            }
        }
        for i in 0..if row.numbers.asked() { robot.links.len() } else { 0 } {
            row.numbers.inertia(robot, &self.data, i, -by, [&adjoint.virtuals[i]; 2]);
        }
        for (i, z) in response[robot.root_dofs()..].iter().enumerate() {
            row.numbers.add(ARMATURE, i, [-by * z * z]);
        }
        adjoint.end_energy(robot, &self.data, response, &mut row.loads);
    }
}
