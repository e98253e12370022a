//! The compliant contact model of the reference simulator, which the paper's authors used.
//!
//! Explicit substeps and self-collision apply [`force`]. In implicit substeps friction with the scene sticks:
//! `touch.rs` and `stick.rs` use only [`drag`].
//!
//! A contact point of radius r has the gap `g = n . (x - p1)` with `x = p0 - r n`, and acts for `g < 0`. The body moves
//! at x with velocity v, `v_n = n . v`, `v_t = v - v_n n`. The normal force along n is
//! `N = max(0, -(k_e g + k_d v_n))`; where `v_n > 0`, `k_e` times `release` takes the place of `k_d`. Friction is
//! `-v_t / |v_t| min(k_f |v_t|, mu N)` (Coulomb), or `-v_t / s min(k_f s, mu N)` with `s = |v_t|^2 / 2` up to 1 m/s and
//! `|v_t| - 1/2` above (Huber). Both friction laws dissipate energy. There is no restitution and no adhesion.

use crate::prelude::*;

/// Force (N) on the body at gap `gap < 0` (m), normal `n` and point velocity `v` (m/s).
#[inline]
pub fn force(gap: f64, n: &Vector3<f64>, v: &Vector3<f64>, material: &Material, friction: Friction) -> Vector3<f64> {
    let vn = n.dot(v);
    let normal = -(material.stiffness * gap + material.damper(vn) * vn).min(0.0);
    let slip = v - n * vn;
    let speed = slip.norm();
    n * normal - slip * drag(normal, speed, material, friction)
}

/// Drag of friction (N s/m), `min(k_f s, mu N) / s` with the size s of the slip, at normal force `normal` (N) and slip
/// `speed` (m/s).
#[inline]
pub fn drag(normal: f64, speed: f64, material: &Material, friction: Friction) -> f64 {
    let limit = material.friction * normal;
    let (size, _) = size(speed, friction);
    // Avoids a division by zero slip.
    if material.friction_damping * size <= limit { material.friction_damping } else { limit / size }
}

/// Size s (m/s) of a slip in the friction law, and its derivative with respect to the slip `speed` (m/s).
#[inline]
fn size(speed: f64, friction: Friction) -> (f64, f64) {
    match friction {
        Friction::Coulomb => (speed, 1.0),
        Friction::Huber if speed <= 1.0 => (0.5 * speed * speed, speed),
        Friction::Huber => (speed - 0.5, 1.0),
    }
}

/// [`drag`] and its derivatives.
#[derive(Clone, Copy, Default)]
pub(super) struct Drag {
    pub(super) value: f64,
    pub(super) by_normal: f64,
    pub(super) by_speed: f64,
    /// Derivatives with respect to the material's `friction_damping` and `friction`.
    pub(super) by_damping: f64,
    pub(super) by_friction: f64,
}

impl Drag {
    /// Drag and derivatives at a `normal` force (N) and a slip `speed` (m/s). A negative normal force counts as 0.
    pub(super) fn of(normal: f64, speed: f64, material: &Material, friction: Friction) -> Self {
        let value = drag(normal.max(0.0), speed, material, friction);
        let (size, gradient) = size(speed, friction);
        if material.friction_damping * size <= material.friction * normal {
            return Self { value, by_damping: 1.0, ..Self::default() };
        }
        if normal <= 0.0 {
            return Self { value, ..Self::default() };
        }
        Self {
            value,
            by_normal: material.friction / size,
            by_speed: -value * gradient / size,
            by_friction: normal / size,
            by_damping: 0.0,
        }
    }
}
