//! Slopes of torsional and rolling friction: the law of `touch.rs`, whose drags follow a contact's normal force.

use super::super::touch::{CREEP, Contact, inside};
use super::law::{At, ContactLaw, part_slopes};
use crate::prelude::*;

/// Torque (N m) of torsional and rolling friction on its link, and its slopes.
pub(super) struct TurnLaw {
    pub(super) torque: Vector3<f64>,
    /// By the change `h J qdd` of the link's angular velocity, and by that at the substep's start.
    pub(super) by_change: Matrix3<f64>,
    pub(super) by_spin: Matrix3<f64>,
    /// By the normal force, which is that of the contact's law, or that of the substep's start.
    pub(super) by_press: Vector3<f64>,
    pub(super) then: Option<Press>,
    /// By the coefficients of torsional and rolling friction.
    pub(super) by_arms: [Vector3<f64>; 2],
    /// By a normal that turns.
    pub(super) by_normal: Matrix3<f64>,
}

/// Slopes of the normal force at a substep's start: by the gap in the middle, by the velocity along the normal, by the stiffness and damping of
/// the whole material.
#[derive(Default)]
pub(super) struct Press {
    pub(super) by_gap: f64,
    pub(super) by_vn: f64,
    pub(super) by_material: [f64; 2],
}

impl Press {
    /// The force (N), at least 0, and its slopes.
    fn then(contact: &Contact, h: f64) -> (f64, Self) {
        let (m, vn) = (&contact.material, contact.normal.dot(&contact.velocity));
        let force = -(m.stiffness * contact.gap + m.damping * vn);
        if force <= 0.0 {
            return (0.0, Self::default());
        }
        let (whole, half) = (&contact.whole, 0.5 * h * vn);
        let (part, _) = inside(contact.middle, half).unwrap_or_default();
        let release = if vn < 0.0 { None } else { Some(whole.release) };
        let (mut by_gap, mut by_vn) = (-m.stiffness, -m.damping);
        if let Some([by_middle, by_half]) = part_slopes(contact.middle, half) {
            let by_part = -contact.gap * whole.stiffness - vn * whole.damper(vn);
            by_vn += (by_gap * -0.5 + by_part * by_half) * (0.5 * h * half.signum());
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        (
            force,
            Self {
                by_gap,
                by_vn,
                by_material: release.map_or([-contact.gap * part, -vn * part], |time| [-(contact.gap + vn * time) * part, 0.0]),
            },
        )
    }
}

impl TurnLaw {
    /// After a change `h J qdd` of the angular velocity of its link, beside the `law` of its force.
    pub(super) fn of(contact: &Contact, at: &At, law: &ContactLaw, change: &Vector3<f64>) -> Self {
        let (n, seen) = (&contact.normal, contact.spin + change);
        let (press, then) = if at.first {
            let (force, slopes) = Press::then(contact, at.h);
            (force, Some(slopes))
        } else {
            (n.dot(&law.force).max(0.0), None)
        };
        // What turns is `seen`; drags are those of `spin`.
        let spin = if at.first { contact.spin } else { seen };
        let (about, about_then) = (n.dot(&seen), n.dot(&spin));
        let (across, across_then) = (seen - n * about, spin - n * about_then);
        let (fast, faster) = (about_then.abs(), across_then.norm());
        let [ease, ease_across] = [fast, faster].map(|rate| 1.0 / rate.max(CREEP));
        let [drag, drag_across] = [contact.whole.torsion * press * ease, contact.whole.rolling * press * ease_across];
        // Slopes of the drags by `spin` along these directions.
        let by_fast = if fast > CREEP { n * (-drag / about_then) } else { Vector3::zeros() };
        let by_faster = if faster > CREEP { across_then * (-drag_across / (faster * faster)) } else { Vector3::zeros() };
        let both = n * n.transpose();
        let by_seen = both * (drag_across - drag) - Matrix3::identity() * drag_across;
        let by_drags = -(n * about * by_fast.transpose() + across * by_faster.transpose());
        let by_normal = (n * seen.transpose() + Matrix3::identity() * about) * (drag_across - drag)
            - n * spin.transpose() * (about * n.dot(&by_fast))
            + across * by_faster.transpose() * about_then;
        let arms = [n * (-about * ease), across * -ease_across];
        Self {
            torque: by_seen * seen,
            by_change: if at.first { by_seen } else { by_seen + by_drags },
            by_spin: by_seen + by_drags,
            by_press: arms[0] * contact.whole.torsion + arms[1] * contact.whole.rolling,
            then,
            by_arms: arms.map(|arm| arm * press),
            by_normal,
        }
    }
}
