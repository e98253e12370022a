//! The compliant contact model of the reference simulator.
//!
//! At a point of radius r, gap `g = n . (x - p1)` with `x = p0 - r n`, active for `g < 0`. With the velocity v of the
//! body at x, `v_n = n . v`, `v_t = v - v_n n`: normal force `N = -(k_e g + k_d min(v_n, 0))` along n; friction
//! `-v_t / |v_t| min(k_f |v_t|, mu N)` (Coulomb), or `-v_t / s min(k_f s, mu N)` with
//! `s = |v_t|^2 / 2` up to 1 m/s and `|v_t| - 1/2` above (Huber). Both are dissipative; no restitution, no adhesion.

use nalgebra::Vector3;

use super::config::Friction;
use crate::scene::Material;

/// Force (N) on the body at gap `gap < 0` (m), normal `n`, point velocity `v` (m/s).
#[inline]
pub fn force(gap: f64, n: &Vector3<f64>, v: &Vector3<f64>, material: &Material, friction: Friction) -> Vector3<f64> {
    let vn = n.dot(v);
    let normal = -(material.stiffness * gap + material.damping * vn.min(0.0));
    let slip = v - n * vn;
    let speed = slip.norm();
    n * normal - slip * drag(normal, speed, material, friction)
}

/// Friction over slip (N s/m), `min(k_f s, mu N) / s`, at normal force `normal` (N) and slip `speed` (m/s).
#[inline]
pub fn drag(normal: f64, speed: f64, material: &Material, friction: Friction) -> f64 {
    let size = match friction {
        Friction::Coulomb => speed,
        Friction::Huber if speed <= 1.0 => 0.5 * speed * speed,
        Friction::Huber => speed - 0.5,
    };
    let limit = material.friction * normal;
    // Without dividing by a vanishing slip.
    if material.friction_damping * size <= limit { material.friction_damping } else { limit / size }
}
