//! Derivatives of torsional and rolling friction (`turning.rs`), with drags that follow a contact's normal force.

use super::super::force::Drag;
use super::super::stick::STICK_DRAG;
use super::super::touch::{Contact, inside};
use super::super::turning::TURN_STICK_DRAG;
use super::contact_law::ContactLaw;
use super::law::{At, part_gradients};
use crate::prelude::*;

/// Torque (N m) of torsional and rolling friction on the link, and its derivatives.
pub(super) struct TurnLaw {
    pub(super) torque: Vector3<f64>,
    /// Derivatives of the torque with respect to the change `h J qdd` of the link's angular velocity (rad/s), and to
    /// that velocity at the substep's start.
    pub(super) by_change: Matrix3<f64>,
    pub(super) by_spin: Matrix3<f64>,
    /// Derivative of the torque with respect to the normal force: of the contact's law, or, if `then` is given, at the
    /// substep's start.
    pub(super) by_press: Vector3<f64>,
    pub(super) then: Option<Press>,
    /// Derivatives of the torque with respect to the coefficients of torsional and rolling friction.
    pub(super) by_arms: [Vector3<f64>; 2],
    /// Derivative of the torque with respect to the normal.
    pub(super) by_normal: Matrix3<f64>,
    /// Derivatives of the torque with respect to the torques (N m) held now and at the substep's start. Then to w
    /// across the normal and the link's squared radius of gyration (m^2), which set the sticking drag.
    pub(super) by_held: Matrix3<f64>,
    pub(super) by_begun: Matrix3<f64>,
    pub(super) by_across: Vector3<f64>,
    pub(super) by_gyration: Vector3<f64>,
}

/// Derivatives of the normal force at a substep's start: with respect to the middle gap, the normal velocity, and
/// stiffness and damping of the unscaled material.
#[derive(Default)]
pub(super) struct Press {
    pub(super) by_gap: f64,
    pub(super) by_vn: f64,
    pub(super) by_material: [f64; 2],
}

impl Press {
    /// Normal force (N) at the substep's start, at least 0, and its derivatives.
    fn then(contact: &Contact, h: f64) -> (f64, Self) {
        let m = &contact.material;
        let vn = contact.normal.dot(&contact.velocity);
        let [damping, _] = contact.dampers[usize::from(vn >= 0.0)];
        let force = -(m.stiffness * contact.gap + damping * vn);
        if force <= 0.0 {
            return (0.0, Self::default());
        }
        let whole = &contact.whole;
        let half = 0.5 * h * vn;
        let (part, _) = inside(contact.middle, half).unwrap_or_default();
        let release = if vn < 0.0 { None } else { Some(whole.release) };
        let (mut by_gap, mut by_vn) = (-m.stiffness, -damping);
        if let Some([by_middle, by_half]) = part_gradients(contact.middle, half) {
            let by_part = -contact.gap * whole.stiffness - vn * whole.damper(vn);
            by_vn += (by_gap * -0.5 + by_part * by_half) * (0.5 * h * half.signum());
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        (
            force,
            Self {
                by_gap,
                by_vn,
                by_material: release
                    .map_or([-contact.gap * part, -vn * part], |time| [-(contact.gap + vn * time) * part, 0.0]),
            },
        )
    }
}

impl TurnLaw {
    /// Torque and derivatives; `change`: change h J qdd (rad/s) of the link's angular velocity; `law`: law of the
    /// contact's force.
    pub(super) fn of(contact: &Contact, at: &At, law: &ContactLaw, change: &Vector3<f64>) -> Self {
        let n = &contact.normal;
        let turning = &contact.turning;
        let seen = turning.spin + change - turning.turn_offset;
        let (press, then) = if at.first {
            let (force, gradients) = Press::then(contact, at.h);
            (force, Some(gradients))
        } else {
            (n.dot(&law.force).max(0.0), None)
        };
        // The torque acts against `seen`; the drags follow from `slip`.
        let slip = if at.first { turning.spin - turning.turn_offset_start } else { seen };
        let (about, about_then) = (n.dot(&seen), n.dot(&slip));
        let (across, across_then) = (seen - n * about, slip - n * about_then);
        let [drag, drag_across] =
            turning.laws(n, &contact.material, &slip).map(|(rate, law)| Drag::of(press, rate, &law, Friction::Coulomb));
        // Derivatives of the drags with respect to `slip`.
        let by_fast = n * (drag.by_speed * about_then.signum());
        let by_faster =
            if drag_across.by_speed == 0.0 { Vector3::zeros() } else { across_then.normalize() * drag_across.by_speed };
        let both = n * n.transpose();
        let by_seen = both * (drag_across.value - drag.value) - Matrix3::identity() * drag_across.value;
        let by_drags = -(n * about * by_fast.transpose() + across * by_faster.transpose());
        let by_normal = (n * seen.transpose() + Matrix3::identity() * about) * (drag_across.value - drag.value)
            - n * slip.transpose() * (about * n.dot(&by_fast))
            + across * by_faster.transpose() * about_then;
        let by = |about_by: f64, across_by: f64| n * (-about * about_by) - across * across_by;
        // The turn offset is the held torque over the sticking drag.
        let c = turning.stick(&contact.material);
        let lin = contact.material.friction_damping;
        let by_slip = by_seen + by_drags;
        let [by_held, by_begun] = if at.first { [by_seen, by_drags] } else { [by_slip, Matrix3::zeros()] };
        let sticks = at.friction == Friction::Coulomb;
        let by_torque = if sticks { -1.0 / c } else { 0.0 };
        let own = |drag: &Drag| if drag.value > 0.0 { drag.by_damping } else { 0.0 };
        let by_stick = by(own(&drag), own(&drag_across))
            + (by_held * turning.turn_offset + by_begun * turning.turn_offset_start) / c;
        Self {
            torque: by_seen * seen,
            by_change: if at.first { by_seen } else { by_slip },
            by_spin: by_slip,
            by_press: by(drag.by_normal, drag_across.by_normal),
            then,
            by_arms: [by(drag.by_friction, 0.0), by(0.0, drag_across.by_friction)],
            by_normal,
            by_held: by_held * by_torque,
            by_begun: by_begun * by_torque,
            by_across: if sticks { by_stick * (-c * lin * at.h / STICK_DRAG) } else { Vector3::zeros() },
            by_gyration: by_stick * (TURN_STICK_DRAG * lin),
        }
    }
}
