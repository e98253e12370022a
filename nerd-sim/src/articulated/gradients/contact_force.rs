//! A contact's force in a substep, with the quantities that its derivatives need.

use super::super::force::Drag;
use super::super::touch::Contact;
use super::law::At;
use crate::prelude::*;

/// Force of a contact, and the quantities that it is computed from.
pub(super) struct Forward<'a> {
    pub(super) contact: &'a Contact,
    pub(super) at: &'a At,
    pub(super) change: Vector3<f64>,
    /// Normal velocity (m/s): `vn` of the contact's `start`, `dn` its change, `vn_then` of `velocity`, where thetas are
    /// chosen.
    pub(super) vn: f64,
    pub(super) dn: f64,
    pub(super) vn_then: f64,
    /// Whether the point parts from the surface, now and at the substep's start; damping (N s/m) of each.
    pub(super) parting: bool,
    pub(super) then_parting: bool,
    pub(super) d: f64,
    pub(super) d_then: f64,
    /// Theta of the damper.
    pub(super) damper: f64,
    /// Normal force.
    pub(super) normal: f64,
    /// Velocity that the drag sees, with its part along the normal; slips now and at the substep's start.
    pub(super) seen: Vector3<f64>,
    pub(super) slip: Vector3<f64>,
    pub(super) slip_then: Vector3<f64>,
    /// Drags now and at the substep's start.
    pub(super) drag: Drag,
    pub(super) then: Drag,
}

impl<'a> Forward<'a> {
    pub(super) fn of(contact: &'a Contact, at: &'a At, change: &Vector3<f64>) -> Self {
        let At { h, friction, first, .. } = *at;
        let n = &contact.normal;
        let m = &contact.material;
        let [spring, _, slide] = contact.theta;
        let change = change + contact.turn;
        let (vn, dn) = (n.dot(&contact.start), n.dot(&change));
        let vn_then = n.dot(&contact.velocity);
        let then_parting = vn_then >= 0.0;
        let parting = if first { then_parting } else { contact.parts(vn, dn) };
        let [[d_then, _], [d, damper]] = [then_parting, parting].map(|parting| contact.dampers[usize::from(parting)]);
        let normal = -(m.stiffness * (contact.gap + spring * h * dn) + d * (vn + damper * dn));
        let seen = contact.start + change * slide - contact.slip_offset;
        let slip = seen - n * n.dot(&seen);
        let slip_then = contact.velocity - n * vn_then - contact.slip_offset_start;
        let then = Drag::of(-(m.stiffness * contact.gap + d_then * vn_then), slip_then.norm(), m, friction);
        let drag = if first {
            Drag { value: then.value, ..Drag::default() }
        } else {
            Drag::of(normal, slip.norm(), m, friction)
        };
        Self {
            contact,
            at,
            change,
            vn,
            dn,
            vn_then,
            parting,
            then_parting,
            d,
            d_then,
            damper,
            normal,
            seen,
            slip,
            slip_then,
            drag,
            then,
        }
    }

    pub(super) fn force(&self) -> Vector3<f64> {
        self.contact.normal * self.normal - self.slip * self.drag.value
    }

    /// Resistance of spring and damper to `dn`.
    pub(super) fn resistance(&self) -> f64 {
        self.contact.material.stiffness * self.contact.theta[0] * self.at.h + self.d * self.damper
    }

    /// Change of the gap over half a substep.
    pub(super) fn half(&self) -> f64 {
        0.5 * self.at.h * self.vn_then
    }

    /// Whether the drag is the material's. A sticking drag follows from w.
    pub(super) fn own_drag(&self) -> bool {
        self.at.friction != Friction::Coulomb
    }
}
