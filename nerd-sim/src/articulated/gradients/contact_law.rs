//! Derivatives of a contact's law in a substep, with respect to its inputs. The code follows `touch.rs`.

use super::super::stick::STICK_DRAG;
use super::super::touch::{Contact, MEAN_THETA, inside};
use super::contact_force::Forward;
use super::law::{At, part_gradients, theta_gradients};
use crate::prelude::*;

/// Force (N) of a contact on its point, and its derivatives.
pub(super) struct ContactLaw {
    pub(super) force: Vector3<f64>,
    /// Derivative of the force with respect to `h J qdd` (m/s); equal to that with respect to `h w x p_dot` (m/s).
    pub(super) by_change: Matrix3<f64>,
    /// Derivatives of the force with respect to `J qd` (m/s), and to `J_dot qd` (m/s^2).
    pub(super) by_velocity: Matrix3<f64>,
    pub(super) by_bend: Matrix3<f64>,
    /// Derivatives of the force with respect to the gap (m) at the middle, and to w.
    pub(super) by_gap: Vector3<f64>,
    pub(super) by_weight: Vector3<f64>,
    /// Derivatives of the force with respect to stiffness, damping, friction damping and friction of the unscaled
    /// material.
    pub(super) by_material: [Vector3<f64>; 4],
    /// Derivative of the force with respect to the normal.
    pub(super) by_normal: Matrix3<f64>,
    /// Derivatives of the force with respect to the forces (N) held now and at the substep's start, and to w across the
    /// normal. The latter w sets the sticking drag.
    pub(super) by_held: Matrix3<f64>,
    pub(super) by_begun: Matrix3<f64>,
    pub(super) by_across: Vector3<f64>,
}

impl ContactLaw {
    /// Force and derivatives at a `change` `h J qdd` (m/s) of the point's velocity. The contact's `start` and `turn`
    /// are the stage's; its material is `whole` scaled to a part of the substep.
    pub(super) fn of(contact: &Contact, at: &At, whole: &Material, change: &Vector3<f64>) -> Self {
        let forward = Forward::of(contact, at, change);
        let mut partials = Partials::of(&forward);
        if !at.mean_theta {
            partials.back_through_thetas(&forward);
        }
        partials.back_to_start(&forward);
        let by_material = partials.by_material(&forward, whole);
        partials.back_through_part(&forward, whole);
        partials.law(&forward, by_material)
    }
}

/// Derivatives of a contact's force with respect to the quantities of [`Forward`]; `by_speed`: to the slip
/// through the drag.
struct Partials {
    by_normal: Vector3<f64>,
    by_slip: Matrix3<f64>,
    by_speed: Matrix3<f64>,
    by_gap: Vector3<f64>,
    by_stiffness: Vector3<f64>,
    by_d: Vector3<f64>,
    by_d_then: Vector3<f64>,
    by_damping: Vector3<f64>,
    by_drag_then: Vector3<f64>,
    by_vn_then: Vector3<f64>,
    by_weight: Vector3<f64>,
}

impl Partials {
    /// Derivatives through normal force and drag, at constant thetas and a constant drag at the substep's start.
    fn of(forward: &Forward) -> Self {
        let Forward { contact, at, vn, dn, damper, slip, drag, .. } = forward;
        let n = &contact.normal;
        // The projection keeps the part across the normal.
        let by_normal = n - slip * drag.by_normal;
        let along = if drag.by_speed == 0.0 { 0.0 } else { drag.by_speed / slip.norm() };
        let by_speed = slip * slip.transpose() * along;
        Self {
            by_normal,
            by_slip: -(by_speed + (Matrix3::identity() - n * n.transpose()) * drag.value),
            by_speed,
            by_gap: by_normal * -contact.material.stiffness,
            by_stiffness: by_normal * -(contact.gap + contact.theta[0] * at.h * dn),
            by_d: by_normal * -(vn + damper * dn),
            by_d_then: Vector3::zeros(),
            by_damping: slip * -drag.by_damping,
            by_drag_then: if at.first { -slip } else { Vector3::zeros() },
            by_vn_then: Vector3::zeros(),
            by_weight: Vector3::zeros(),
        }
    }

    /// Adds the derivatives through the thetas, which follow from stiffness, damping, drag and w.
    fn back_through_thetas(&mut self, forward: &Forward) {
        let Forward { contact, dn, d, damper, then, .. } = *forward;
        let At { h, weight: w, .. } = *forward.at;
        let k = contact.material.stiffness;
        let [spring, _, slide] = contact.theta;
        let by_spring = self.by_normal * -(k * h * dn);
        let by_damper = self.by_normal * -(d * dn);
        let by_slide = self.by_slip * forward.change;
        let shares = [
            (theta_gradients(spring, MEAN_THETA, 0.5 - spring, k, w), by_spring, &mut self.by_stiffness),
            (theta_gradients(damper, 0.5, 1.0 - damper, d, w), by_damper, &mut self.by_d),
            (theta_gradients(slide, 0.5, 1.0 - slide, then.value, w), by_slide, &mut self.by_drag_then),
        ];
        for ([by_own, by_w], by_share, by) in shares {
            *by += by_share * by_own;
            self.by_weight += by_share * by_w;
        }
    }

    /// Adds the derivatives through the drag at the substep's start.
    fn back_to_start(&mut self, forward: &Forward) {
        let Forward { contact, vn_then, d_then, then, .. } = *forward;
        let by_normal_then = self.by_drag_then * then.by_normal;
        self.by_gap -= by_normal_then * contact.material.stiffness;
        self.by_stiffness -= by_normal_then * contact.gap;
        self.by_d_then = by_normal_then * -vn_then;
        self.by_damping += self.by_drag_then * then.by_damping;
        self.by_vn_then = by_normal_then * -d_then;
    }

    fn by_material(&self, forward: &Forward, whole: &Material) -> [Vector3<f64>; 4] {
        let mut pressed = [self.by_stiffness, Vector3::zeros()];
        for (parting, by) in [(forward.parting, self.by_d), (forward.then_parting, self.by_d_then)] {
            pressed[0] += if parting { by * whole.release } else { Vector3::zeros() };
            pressed[1] += if parting { Vector3::zeros() } else { by };
        }
        // The part of the substep that the point is inside.
        let (part, _) = inside(forward.contact.middle, forward.half()).unwrap_or_default();
        [
            pressed[0] * part,
            pressed[1] * part,
            if forward.own_drag() { self.by_damping * part } else { Vector3::zeros() },
            self.by_drag_then * forward.then.by_friction - forward.slip * forward.drag.by_friction,
        ]
    }

    /// Turns the derivative with respect to the mean gap into one with respect to the gap at the middle. Adds the
    /// derivatives through the part of the substep that the point is inside, which scales the material.
    fn back_through_part(&mut self, forward: &Forward, whole: &Material) {
        let half = forward.half();
        let damping = |parting: bool| if parting { whole.stiffness * whole.release } else { whole.damping };
        let mut by_part = self.by_stiffness * whole.stiffness
            + self.by_d * damping(forward.parting)
            + self.by_d_then * damping(forward.then_parting);
        if forward.own_drag() {
            by_part += self.by_damping * whole.friction_damping;
        }
        if let Some([by_middle, by_half]) = part_gradients(forward.contact.middle, half) {
            self.by_vn_then += (self.by_gap * -0.5 + by_part * by_half) * (0.5 * forward.at.h * half.signum());
            self.by_gap = self.by_gap * 0.5 + by_part * by_middle;
        }
    }

    fn law(self, forward: &Forward, by_material: [Vector3<f64>; 4]) -> ContactLaw {
        let Forward { contact, at, vn_then, d, slip_then, then, .. } = forward;
        let n = &contact.normal;
        let c = contact.material.friction_damping;
        let by_start = self.by_slip - self.by_normal * n.transpose() * *d;
        let by_change = self.by_slip * contact.theta[2] - self.by_normal * n.transpose() * forward.resistance();
        let mut by_velocity = by_start + self.by_vn_then * n.transpose();
        let mut by_turned = self.by_turned(forward);
        let mut by_begun = Matrix3::zeros();
        // The slip offset is the held force over the sticking drag.
        let mut by_stick = self.by_damping + self.by_slip * contact.slip_offset / c;
        let speed_then = slip_then.norm();
        if speed_then > 0.0 {
            let by_slip_then = self.by_drag_then * slip_then.transpose() * (then.by_speed / speed_then);
            by_velocity += by_slip_then;
            by_turned -= by_slip_then * *vn_then;
            by_stick += by_slip_then * contact.slip_offset_start / c;
            by_begun = by_slip_then;
        }
        let sticks = !forward.own_drag() && c > 0.0;
        let by_force = if sticks { -1.0 / c } else { 0.0 };
        ContactLaw {
            force: forward.force(),
            by_change,
            by_velocity,
            by_bend: (by_change - by_start * 0.5) * at.h,
            by_gap: self.by_gap,
            by_weight: self.by_weight,
            by_material,
            by_normal: by_turned,
            by_held: self.by_slip * by_force,
            by_begun: by_begun * by_force,
            by_across: if sticks { by_stick * (-c * c * at.h / STICK_DRAG) } else { Vector3::zeros() },
        }
    }

    /// Derivative with respect to the normal, which splits vectors into their parts along and across.
    fn by_turned(&self, forward: &Forward) -> Matrix3<f64> {
        let Forward { contact, change, normal, seen, drag, d, .. } = forward;
        let across = contact.normal.dot(seen);
        Matrix3::from_diagonal_element(normal + drag.value * across)
            + contact.normal * seen.transpose() * drag.value
            + self.by_speed * across
            - self.by_normal * (change * forward.resistance() + contact.start * *d).transpose()
            + self.by_vn_then * contact.velocity.transpose()
    }
}
