//! Start state of a cable at rest. One part hangs from a gripper that points along x; the rest lies straight on a
//! floor.
//!
//! The hanging part is a catenary, `tan(slope) = (s - l) / a`, at arc length s (m) from the free end. The lying length
//! is l (m). The tension at the floor over the weight per metre is a (m). Within [`STEM`] of the gripper the cable
//! bends away from the clamp's direction. The length l is chosen so that the free end lies on the floor.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// a (m): half of the largest friction force on the lying part, divided by the weight per metre. The lying part is a
/// fifth of the lead, with friction coefficient 0.5.
const PULL: f64 = 0.05;
/// Length (m) over which the clamp's direction decays along the cable: `sqrt(E I / T)`, with T the weight of the lead
/// (N).
const STEM: f64 = 0.04;
/// Number of bisections for l, which find l to a billionth of the cable's length.
const HALVINGS: usize = 30;

/// Directions `[rod]` (unit length) of `rods` rods of length `rod` (m), from a gripper `height` (m) above the floor.
/// The free end lies in direction `heading` (rad, from x). A cable too short for the floor hangs along its whole
/// length.
pub fn drape(rods: usize, rod: f64, height: f64, heading: f64) -> Vec<Vector3<f64>> {
    let along = |lying: f64| -> Vec<Vector3<f64>> {
        let direction = |k: usize| {
            let from_clamp = (k as f64 + 0.5) * rod;
            let from_end = rods as f64 * rod - from_clamp;
            let left = 1.0 - (-from_clamp / STEM).exp();
            let slope = left * ((from_end - lying).max(0.0) / PULL).atan();
            let (sin, cos) = (left * heading).sin_cos();
            Vector3::new(cos * slope.cos(), sin * slope.cos(), -slope.sin())
        };
        (0..rods).map(direction).collect()
    };
    let drop = |along: &[Vector3<f64>]| -rod * along.iter().map(|t| t.z).sum::<f64>();
    let (mut low, mut high) = (0.0, rods as f64 * rod);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        // Too large a drop: more of the cable must lie.
        if drop(&along(middle)) > height { low = middle } else { high = middle }
    }
    along(low)
}

/// Hinge angles (rad, about z then y), `[rod][2]`, that give the rods the directions `along`, for a gripper at home.
pub fn hinges(along: &[Vector3<f64>]) -> Vec<f64> {
    let mut axes = Matrix3::identity();
    let mut angles = Vec::with_capacity(2 * along.len());
    for direction in along {
        let own = axes.tr_mul(direction);
        let sway = own.y.atan2(own.x);
        let bend = (-own.z).atan2(own.x.hypot(own.y));
        axes *=
            Rotation3::from_axis_angle(&Vector3::z_axis(), sway) * Rotation3::from_axis_angle(&Vector3::y_axis(), bend);
        angles.extend([sway, bend]);
    }
    angles
}
