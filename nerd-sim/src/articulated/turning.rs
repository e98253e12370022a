//! Torsional and rolling friction of a contact: torques about and across its normal that stick as its friction does
//! (`touch.rs`).
//!
//! Each torque is `-c (w - w_0)`. The drag c is the sticking drag, or `arm N / |w - w_0|` on Coulomb's cone, with a
//! friction coefficient `arm` (m). The offset `w_0` is such that a link at rest feels the torque of the last substep.

use super::force::drag;
use super::stick::{STICK_DRAG, breaking};
use crate::prelude::*;

/// Least squared radius of gyration of a link (m^2).
pub(super) const MIN_GYRATION: f64 = 1e-6;
/// Ratio of a torque's sticking drag to the sticking drag of slip times the link's squared radius of gyration. For a
/// ball or a box on the ground the torque's drag is then [`STICK_DRAG`] times the angular inertia over the substep.
pub(super) const TURN_STICK_DRAG: f64 = 8.0;
/// Angular inertia over the substep that breakaway assumes, in units of `stick / STICK_DRAG`.
pub(super) const TURN_INERTIA: f64 = 1.2;

#[derive(Clone, Copy, Default)]
pub(super) struct Turning {
    /// Angular velocity of the link (rad/s).
    pub(super) spin: Vector3<f64>,
    /// Squared radius of gyration of the link (m^2).
    pub(super) gyration: f64,
    /// Drags (N m s/rad) about the normal and across it.
    pub(super) drags: [f64; 2],
    /// Angular velocity offsets `w_0` (rad/s) with zero torque, now and at the substep's start.
    pub(super) turn_offset: Vector3<f64>,
    pub(super) turn_offset_start: Vector3<f64>,
    /// Torque (N m) on the link in the substep.
    pub(super) torque: Vector3<f64>,
}

impl Turning {
    /// Sticking drag (N m s/rad).
    pub(super) fn stick(&self, m: &Material) -> f64 {
        TURN_STICK_DRAG * self.gyration * m.friction_damping
    }

    /// Angular speeds (rad/s) about the normal and across it, each with its friction law in the form of a material.
    pub(super) fn laws(&self, n: &Vector3<f64>, m: &Material, slip: &Vector3<f64>) -> [(f64, Material); 2] {
        let about = n.dot(slip);
        let stick = |arm: f64| if arm > 0.0 { self.stick(m) } else { 0.0 };
        let law = |arm: f64| Material { friction_damping: stick(arm), friction: arm, ..*m };
        [(about.abs(), law(m.torsion)), ((slip - n * about).norm(), law(m.rolling))]
    }

    /// Computes the drags at the substep's start, under a normal force (N).
    pub(super) fn set_thetas(&mut self, n: &Vector3<f64>, m: &Material, normal: f64) {
        let laws = self.laws(n, m, &(self.spin - self.turn_offset));
        self.drags = laws.map(|(rate, law)| drag(normal, rate, &law, Friction::Coulomb));
    }

    /// Torque (N m) of the drags at an angular velocity (rad/s).
    #[inline]
    pub(super) fn resists(&self, n: &Vector3<f64>, spin: &Vector3<f64>) -> Vector3<f64> {
        let [about, across] = self.drags;
        n * (-(about - across) * n.dot(spin)) - spin * across
    }

    /// Updates torque and drags under a contact force (N), after a change of the angular velocity (rad/s). Returns
    /// whether another solve is needed.
    pub(super) fn settle(
        &mut self,
        (n, m): (&Vector3<f64>, &Material),
        force: Option<&Vector3<f64>>,
        change: &Vector3<f64>,
        (settled, leap): (f64, bool),
    ) -> bool {
        let normal = force.map_or(0.0, |f| n.dot(f).max(0.0));
        let slip = self.spin + change - self.turn_offset;
        self.torque = if force.is_some() { self.resists(n, &slip) } else { Vector3::zeros() };
        let laws = self.laws(n, m, &slip);
        let inertia = TURN_INERTIA * self.stick(m) / STICK_DRAG;
        let old = self.drags;
        for (own, (rate, law)) in self.drags.iter_mut().zip(&laws) {
            *own = if leap {
                breaking(normal, *rate, *own, law, inertia)
            } else {
                drag(normal, *rate, law, Friction::Coulomb)
            };
        }
        self.drags.iter().zip(old).any(|(new, old)| (new - old).abs() > settled * old.max(1e-12))
    }
}

/// Harmonic mean of a link's squared radii of gyration (m^2): the sticking drag then suits the axis of least inertia.
pub(super) fn gyration(link: &Link) -> f64 {
    link.inertia
        .inertia
        .try_inverse()
        .map_or(MIN_GYRATION, |inverse| 3.0 / (link.inertia.mass * inverse.trace()))
        .max(MIN_GYRATION)
}
