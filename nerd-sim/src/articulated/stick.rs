//! Friction that sticks: constants and breakaway. `touch.rs` applies them to slip, `turning.rs` to rotation. On a GPU
//! `device/touch.cuh` and `device/press.cuh` apply them.

use super::force::drag;
use crate::prelude::*;

/// Drag of a sticking contact, in units of `1 / (h w)`. Each solve leaves about a thousandth of the slip, so a few
/// solves make friction stick. The matrix stays well conditioned.
pub(super) const STICK_DRAG: f64 = 2e3;
/// Lower bound on w across the normal (1/kg). The bound limits the sticking drag of a point that cannot move across the
/// normal.
pub(super) const MIN_INV_MASS: f64 = 1e-12;
/// Factor on the wrench of a sticking contact that the next stage of a substep starts from. The factor adds the force
/// that stops the slip left by the stage before, where w is isotropic across the normal.
pub(super) const HELD_FACTOR: f64 = 1.0 + 2.0 / STICK_DRAG;

/// Breakaway slip, as a fraction of the slip that the force beyond the friction cone would give the contact's own
/// inertia. With all of that slip, the points of one body would stick and slip in turns.
pub(super) const BREAKAWAY: f64 = 0.5;
/// Slip (m/s) at which a sticking contact still creeps, and velocities (rad/s, m/s) below which a robot is at rest. A
/// frame that creeps at rest takes at least `SUBSTEPS_AT_REST` substeps; with more
/// of them it creeps less.
pub(super) const CREEPS: f64 = 1e-7;
pub(super) const AT_REST: f64 = 1e-3;
pub(super) const SUBSTEPS_AT_REST: usize = 4;
/// Number of a substep's first solves that assume a breakaway slip; in later solves drags converge without it.
pub(super) const BREAKAWAY_SOLVES: usize = 6;

/// Drag (N s/m or N m s/rad) at a slip `rate` (m/s or rad/s) under a normal force (N). `inertia` is the effective
/// inertia over the substep. Where the drag `before` exceeds `inertia`, and its force the friction cone, the rate
/// includes the breakaway slip. Otherwise each solve would reduce a sticking drag only by the ratio of its force to the
/// cone.
pub(super) fn breaking(normal: f64, rate: f64, before: f64, law: &Material, inertia: f64) -> f64 {
    let over = rate * before - law.friction * normal;
    let leap = if over > 0.0 && before > inertia { BREAKAWAY * over / inertia } else { 0.0 };
    drag(normal, rate + leap, law, Friction::Coulomb)
}
