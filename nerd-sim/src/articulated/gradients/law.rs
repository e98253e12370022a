//! Derivatives of the laws of touches in a substep, with respect to their inputs. The code follows `touch.rs` line by
//! line.

use super::super::force::Drag;
use super::super::stick::STICK_DRAG;
use super::super::touch::{CREEP, Contact, DryFriction, MEAN_THETA, Spring, inside};
use crate::prelude::*;

/// Inputs of a touch's law, in addition to the touch.
#[derive(Clone, Copy)]
pub(super) struct At {
    pub(super) h: f64,
    /// Inverse effective mass w of the touch, see `implicit.rs`.
    pub(super) weight: f64,
    pub(super) friction: Friction,
    /// Whether drags are those at the substep's start, instead of solved drags.
    pub(super) first: bool,
    /// Whether thetas of contacts and limits are constant (`energy.rs`).
    pub(super) mean_theta: bool,
}

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

/// Derivatives of a theta above its least value, with respect to a stiffness (or damping) x and to w. `short` is the
/// limit at infinite stiffness less theta.
fn theta_gradients(share: f64, least: f64, short: f64, x: f64, w: f64) -> [f64; 2] {
    if share > least { [short / x, short / w] } else { [0.0; 2] }
}

impl ContactLaw {
    /// Force and derivatives at a `change` `h J qdd` (m/s) of the point's velocity. The contact's `start` and `turn`
    /// are the stage's; its material is `material` scaled to a part of the substep.
    pub(super) fn of(contact: &Contact, at: &At, material: &Material, change: &Vector3<f64>) -> Self {
        let At { h, weight: w, friction, first, mean_theta } = *at;
        let n = &contact.normal;
        let m = &contact.material;
        let gap = contact.gap;
        let [spring, _, slide] = contact.theta;
        let change = change + contact.turn;
        let (vn, dn) = (n.dot(&contact.start), n.dot(&change));
        // Normal velocity at the substep's start, where thetas are chosen.
        let vn_then = n.dot(&contact.velocity);
        let then_parting = vn_then >= 0.0;
        let parting = if first { then_parting } else { contact.parts(vn, dn) };
        let [[d_then, _], [d, damper]] = [then_parting, parting].map(|parting| contact.dampers[usize::from(parting)]);
        let k = m.stiffness;
        let normal = -(k * (gap + spring * h * dn) + d * (vn + damper * dn));
        let seen = contact.start + change * slide - contact.slip_offset;
        let slip = seen - n * n.dot(&seen);
        let slip_then = contact.velocity - n * vn_then - contact.slip_offset_start;
        let speed_then = slip_then.norm();
        let then = Drag::of(-(k * gap + d_then * vn_then), speed_then, m, friction);
        let drag = if first {
            Drag { value: then.value, ..Drag::default() }
        } else {
            Drag::of(normal, slip.norm(), m, friction)
        };
        let force = n * normal - slip * drag.value;

        // Derivatives of the force with respect to normal force and slip; the projection keeps the part across the
        // normal.
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
        if !mean_theta {
            let shares = [
                (theta_gradients(spring, MEAN_THETA, 0.5 - spring, k, w), by_normal * -(k * h * dn), &mut by_k),
                (theta_gradients(damper, 0.5, 1.0 - damper, d, w), by_normal * -(d * dn), &mut by_d),
                (theta_gradients(slide, 0.5, 1.0 - slide, then.value, w), by_slip * change, &mut by_drag_then),
            ];
            for ([by_own, by_w], by_share, by) in shares {
                *by += by_share * by_own;
                by_weight += by_share * by_w;
            }
        }
        let by_normal_then = by_drag_then * then.by_normal;
        by_gap -= by_normal_then * k;
        by_k -= by_normal_then * gap;
        let by_d_then = by_normal_then * -vn_then;
        by_drag += by_drag_then * then.by_damping;
        let mut by_vn = by_normal_then * -d_then;
        let half = 0.5 * h * vn_then;
        let mut pressed = [by_k, Vector3::zeros()];
        for (parting, by) in [(parting, by_d), (then_parting, by_d_then)] {
            pressed[0] += if parting { by * material.release } else { Vector3::zeros() };
            pressed[1] += if parting { Vector3::zeros() } else { by };
        }
        // The part of the substep that the point is inside.
        let (part, _) = inside(contact.middle, half).unwrap_or_default();
        // A sticking drag follows from w, not from the material.
        let own_drag = friction != Friction::Coulomb;
        let by_friction = by_drag_then * then.by_friction - slip * drag.by_friction;
        let by_material = [
            pressed[0] * part,
            pressed[1] * part,
            if own_drag { by_drag * part } else { Vector3::zeros() },
            by_friction,
        ];
        let whole = |parting: bool| if parting { material.stiffness * material.release } else { material.damping };
        let mut by_part = by_k * material.stiffness + by_d * whole(parting) + by_d_then * whole(then_parting);
        if own_drag {
            by_part += by_drag * material.friction_damping;
        }
        if let Some([by_middle, by_half]) = part_gradients(contact.middle, half) {
            by_vn += (by_gap * -0.5 + by_part * by_half) * (0.5 * h * half.signum());
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        let mut by_velocity = by_start + by_vn * n.transpose();
        // Derivative with respect to the normal, which splits vectors into their parts along and across.
        let across = n.dot(&seen);
        let mut by_turned = Matrix3::from_diagonal_element(normal + drag.value * across)
            + n * seen.transpose() * drag.value
            + own * across
            - by_normal * (change * (k * spring * h + d * damper) + contact.start * d).transpose()
            + by_vn * contact.velocity.transpose();
        let c = m.friction_damping;
        let mut by_begun = Matrix3::zeros();
        // The slip offset is the held force over the sticking drag.
        let mut by_stick = by_drag + by_slip * contact.slip_offset / c;
        if speed_then > 0.0 {
            let by_slip_then = by_drag_then * slip_then.transpose() * (then.by_speed / speed_then);
            by_velocity += by_slip_then;
            by_turned -= by_slip_then * vn_then;
            by_stick += by_slip_then * contact.slip_offset_start / c;
            by_begun = by_slip_then;
        }
        let sticks = !own_drag && c > 0.0;
        let by_force = if sticks { -1.0 / c } else { 0.0 };
        let by_across = if sticks { by_stick * (-c * c * h / STICK_DRAG) } else { Vector3::zeros() };
        let by_bend = (by_change - by_start * 0.5) * h;
        Self {
            force,
            by_change,
            by_velocity,
            by_bend,
            by_gap,
            by_weight,
            by_material,
            by_normal: by_turned,
            by_held: by_slip * by_force,
            by_begun: by_begun * by_force,
            by_across,
        }
    }
}

/// Derivatives of the part in `touch::inside`: with respect to the middle gap, and to the size of its change over half
/// a substep. The derivatives of the mean gap are 1/2 and -1/2. `None` where the gap is negative throughout: there the
/// mean gap is the middle gap.
pub(super) fn part_gradients(middle: f64, half: f64) -> Option<[f64; 2]> {
    let half = half.abs();
    (middle + half > 0.0).then(|| [-0.5 / half, 0.5 * middle / (half * half)])
}

/// Derivatives of a touch's torque at one joint, with respect to `h qdd`, coordinate, rate and w.
#[derive(Default)]
pub(super) struct JointLaw {
    pub(super) by_change: f64,
    pub(super) by_gap: f64,
    pub(super) by_rate: f64,
    pub(super) by_weight: f64,
    /// Derivative of the torque with respect to the largest dry friction.
    pub(super) by_most: f64,
}

impl JointLaw {
    /// Derivatives of a spring's torque after a `change` `h qdd` of its joint's velocity. `whole`: a limit's stiffness
    /// and damping before they are scaled to the part of the substep beyond the limit; `None` for a drive.
    pub(super) fn spring(spring: &Spring, at: &At, whole: Option<[f64; 2]>, change: f64) -> Self {
        let At { h, weight: w, mean_theta, .. } = *at;
        let k = spring.stiffness;
        let d = spring.damping;
        let gap = spring.gap;
        let [theta, damper] = spring.theta;
        let change = spring.side * change;
        let (mut by_k, mut by_d) = (-(gap + theta * h * change), -(spring.rate + damper * change));
        let (mut by_gap, mut by_rate, mut by_weight) = (-k, -d, 0.0);
        if !(mean_theta && whole.is_some()) {
            let shares = [
                (theta_gradients(theta, MEAN_THETA, 0.5 - theta, k, w), -k * h * change, &mut by_k),
                (theta_gradients(damper, 0.5, 1.0 - damper, d, w), -d * change, &mut by_d),
            ];
            for ([by_own, by_w], by_share, by) in shares {
                *by += by_share * by_own;
                by_weight += by_share * by_w;
            }
        }
        let half = 0.5 * h * spring.rate;
        if let Some(([stiffness, damping], [by_middle, by_half])) = whole.zip(part_gradients(spring.middle, half)) {
            let by_part = by_k * stiffness + by_d * damping;
            by_rate += (by_gap * -0.5 + by_part * by_half) * 0.5 * h * half.signum();
            by_gap = by_gap * 0.5 + by_part * by_middle;
        }
        Self {
            by_change: -(k * theta * h + d * damper),
            by_gap,
            by_rate,
            by_weight: spring.side * by_weight,
            by_most: 0.0,
        }
    }

    /// Derivatives of the torque of dry friction after a `change` `h qdd` of its joint's velocity.
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
        let gradient = -(now.value + seen.abs() * now.by_speed);
        Self { by_change: gradient, by_rate: gradient, by_most: by_most(&now), ..Self::default() }
    }
}
