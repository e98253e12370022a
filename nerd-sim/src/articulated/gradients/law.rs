//! Derivatives of the laws of joints' touches in a substep, with respect to their inputs, and what they share with those
//! of contacts. The code follows `touch.rs` line by line.

use super::super::force::Drag;
use super::super::touch::{CREEP, DryFriction, MEAN_THETA, Spring};
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

/// Derivatives of a theta above its least value, with respect to a stiffness (or damping) x and to w. `short` is the
/// limit at infinite stiffness less theta.
pub(super) fn theta_gradients(share: f64, least: f64, short: f64, x: f64, w: f64) -> [f64; 2] {
    if share > least { [short / x, short / w] } else { [0.0; 2] }
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
