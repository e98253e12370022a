//! Slopes of what touches do in a substep, by what they see: the laws of `touch.rs`, line by line.

use super::super::force::Drag;
use super::super::touch::{CREEP, Contact, DryFriction, EVEN, Spring, inside};
use crate::prelude::*;

/// What a touch's law is asked at, beside itself.
#[derive(Clone, Copy)]
pub(super) struct At {
    pub(super) h: f64,
    /// Its w, see `implicit.rs`.
    pub(super) weight: f64,
    pub(super) friction: Friction,
    /// Whether drags are those of the substep's start, in place of the solved ones.
    pub(super) first: bool,
    /// Whether shares are those of `energy.rs`, which nothing changes.
    pub(super) even: bool,
}

/// Force (N) of a contact on its point, and its slopes.
pub(super) struct ContactLaw {
    pub(super) force: Vector3<f64>,
    /// By `h J qdd`, and by `h w x v`.
    pub(super) by_change: Matrix3<f64>,
    /// By the velocity at the substep's start, and by what that changes by over time (m/s^2).
    pub(super) by_velocity: Matrix3<f64>,
    pub(super) by_bend: Matrix3<f64>,
    /// By the gap in the middle, and by w.
    pub(super) by_gap: Vector3<f64>,
    pub(super) by_weight: Vector3<f64>,
    /// By the stiffness, damping, friction damping and friction of the whole material.
    pub(super) by_material: [Vector3<f64>; 4],
    /// By a normal that turns.
    pub(super) by_normal: Matrix3<f64>,
}

/// Slopes of a share that a stiffness (or damping) x has at a weight w where it is not the least one: by x and by w.
fn share_slopes(share: f64, least: f64, short: f64, x: f64, w: f64) -> [f64; 2] {
    if share > least { [short / x, short / w] } else { [0.0; 2] }
}

impl ContactLaw {
    /// After a change `h J qdd` of its velocity; `start` and `turn` of the contact are those of the stage, and a part of the whole `material` acts.
    pub(super) fn of(contact: &Contact, at: &At, material: &Material, change: &Vector3<f64>) -> Self {
        let At { h, weight: w, friction, first, even } = *at;
        let (n, m, gap, [spring, damper, slide]) = (&contact.normal, &contact.material, contact.gap, contact.ahead);
        let (k, d) = (m.stiffness, m.damping);
        let change = change + contact.turn;
        let (vn, dn) = (n.dot(&contact.start), n.dot(&change));
        let normal = -(k * (gap + spring * h * dn) + d * (vn + damper * dn));
        let seen = contact.start + change * slide;
        let slip = seen - n * n.dot(&seen);
        // As the substep begins, where shares are chosen.
        let vn_then = n.dot(&contact.velocity);
        let slip_then = contact.velocity - n * vn_then;
        let speed_then = slip_then.norm();
        let then = Drag::of(-(k * gap + d * vn_then), speed_then, m, friction);
        let drag = if first { Drag { value: then.value, ..Drag::default() } } else { Drag::of(normal, slip.norm(), m, friction) };
        let force = n * normal - slip * drag.value;

        // By the normal force, and by the slip; what acts on that lies across the normal.
        let by_normal = n - slip * drag.by_normal;
        let along = if drag.by_speed == 0.0 { 0.0 } else { drag.by_speed / slip.norm() };
        let own = slip * slip.transpose() * along;
        let by_slip = -(own + (Matrix3::identity() - n * n.transpose()) * drag.value);
        let by_start = by_slip - by_normal * n.transpose() * d;
        let by_change = by_slip * slide - by_normal * n.transpose() * (k * spring * h + d * damper);
        let mut by_gap = by_normal * -k;
        let mut by_k = by_normal * -(gap + spring * h * dn);
        let mut by_d = by_normal * -(vn + damper * dn);
        let mut by_drag = slip * -drag.by_damping;
        let mut by_weight = Vector3::zeros();
        let mut by_drag_then = if first { -slip } else { Vector3::zeros() };
        if !even {
            let shares = [
                (share_slopes(spring, EVEN, 0.5 - spring, k, w), by_normal * -(k * h * dn), &mut by_k),
                (share_slopes(damper, 0.5, 1.0 - damper, d, w), by_normal * -(d * dn), &mut by_d),
                (share_slopes(slide, 0.5, 1.0 - slide, then.value, w), by_slip * change, &mut by_drag_then),
            ];
            for ([by_own, by_w], by_share, by) in shares {
                *by += by_share * by_own;
                by_weight += by_share * by_w;
            }
        }
        let by_normal_then = by_drag_then * then.by_normal;
        by_gap -= by_normal_then * k;
        by_k -= by_normal_then * gap;
        by_d -= by_normal_then * vn_then;
        by_drag += by_drag_then * then.by_damping;
        let mut by_vn = by_normal_then * -d;
        let half = 0.5 * h * vn_then;
        // The part of the substep in which it is inside.
        let pressed = if vn_then < 0.0 { [by_k, by_d] } else { [by_k + by_d * material.release, Vector3::zeros()] };
        let (part, _) = inside(contact.middle, half).unwrap_or_default();
        let by_friction = by_drag_then * then.by_friction - slip * drag.by_friction;
        let by_material = [pressed[0] * part, pressed[1] * part, by_drag * part, by_friction];
        let by_part = by_k * material.stiffness + by_d * material.damper(vn_then) + by_drag * material.friction_damping;
        if let Some([by_middle, by_half]) = part_slopes(contact.middle, half) {
            by_vn += (by_gap * -0.5 + by_part * by_half) * (0.5 * h * half.signum());
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        let mut by_velocity = by_start + by_vn * n.transpose();
        // A normal turns what lies along it and across.
        let across = n.dot(&seen);
        let mut by_turned = Matrix3::from_diagonal_element(normal + drag.value * across) + n * seen.transpose() * drag.value + own * across
            - by_normal * (change * (k * spring * h + d * damper) + contact.start * d).transpose()
            + by_vn * contact.velocity.transpose();
        if speed_then > 0.0 {
            let by_slip_then = by_drag_then * slip_then.transpose() * (then.by_speed / speed_then);
            by_velocity += by_slip_then;
            by_turned -= by_slip_then * vn_then;
        }
        let by_bend = (by_change - by_start * 0.5) * h;
        Self { force, by_change, by_velocity, by_bend, by_gap, by_weight, by_material, by_normal: by_turned }
    }
}

/// Slopes of the part in `touch::inside`, by the gap in the middle and by the size of what it changes by in half a substep; those of the gap are a
/// half, and minus that. None of what is inside all the time: then the gap is that of the middle.
pub(super) fn part_slopes(middle: f64, half: f64) -> Option<[f64; 2]> {
    let half = half.abs();
    (middle + half > 0.0).then(|| [-0.5 / half, 0.5 * middle / (half * half)])
}

/// Slopes of what acts at one joint, of its torque: by `h qdd`, by its coordinate and rate, by its w.
#[derive(Default)]
pub(super) struct JointLaw {
    pub(super) by_change: f64,
    pub(super) by_gap: f64,
    pub(super) by_rate: f64,
    pub(super) by_weight: f64,
    /// By the largest dry friction.
    pub(super) by_most: f64,
}

impl JointLaw {
    /// Of a spring after a change `h qdd` of its joint's rate; `whole` are the stiffness and damping of a limit, of which a part may act.
    pub(super) fn spring(spring: &Spring, at: &At, whole: Option<[f64; 2]>, change: f64) -> Self {
        let At { h, weight: w, even, .. } = *at;
        let (k, d, gap, [ahead, damper]) = (spring.stiffness, spring.damping, spring.gap, spring.ahead);
        let change = spring.side * change;
        let (mut by_k, mut by_d) = (-(gap + ahead * h * change), -(spring.rate + damper * change));
        let (mut by_gap, mut by_rate, mut by_weight) = (-k, -d, 0.0);
        if !(even && whole.is_some()) {
            let shares = [
                (share_slopes(ahead, EVEN, 0.5 - ahead, k, w), -k * h * change, &mut by_k),
                (share_slopes(damper, 0.5, 1.0 - damper, d, w), -d * change, &mut by_d),
            ];
            for ([by_own, by_w], by_share, by) in shares {
                *by += by_share * by_own;
                by_weight += by_share * by_w;
            }
        }
        let half = 0.5 * h * spring.rate;
        if let Some(([stiffness, damping], [by_middle, by_half])) = whole.zip(part_slopes(spring.middle, half)) {
            let by_part = by_k * stiffness + by_d * damping;
            by_rate += (by_gap * -0.5 + by_part * by_half) * 0.5 * h * half.signum();
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        Self { by_change: -(k * ahead * h + d * damper), by_gap, by_rate, by_weight: spring.side * by_weight, by_most: 0.0 }
    }

    /// Of dry friction.
    pub(super) fn friction(dry: &DryFriction, at: &At, change: f64) -> Self {
        let seen = dry.rate + change;
        let material = dry.material();
        let drag = |rate: f64| Drag::of(dry.most, rate.abs(), &material, at.friction);
        let by_most = |drag: &Drag| -seen * (drag.by_normal + drag.by_damping / CREEP);
        if at.first {
            let then = drag(dry.rate);
            let by_rate = -(then.value + seen * then.by_speed * dry.rate.signum());
            return Self { by_change: -then.value, by_rate, by_most: by_most(&then), ..Self::default() };
        }
        let now = drag(seen);
        let slope = -(now.value + seen.abs() * now.by_speed);
        Self { by_change: slope, by_rate: slope, by_most: by_most(&now), ..Self::default() }
    }
}
