//! Midpoint angular velocity of a free root that spins fast, by Newton's method.
//!
//! The gyroscopic torque of a substep is taken at its middle, `-w x I w` with `w = (w_0 + w_1) / 2`. At the exact mean
//! this torque does no work for any substep h: `w . (I (w_1 - w_0)) = -h w . (w x I w) = 0`. At a mean predicted from
//! the last substep's rate the torque adds energy to a body in flight. So where a root turns by more than [`FAST_ROOT`]
//! in a substep, Newton's method finds the mean. The method keeps the inertia I of the whole robot about its centre of
//! mass constant. The solve with w gives the acceleration a, and with `off = (w_0 + h a / 2) - w` the step is
//!
//! ```text
//! (I + h/2 ([w] I - [I w])) change = I off
//! ```
//!
//! This step is exact for one link without contact, and the backward pass uses its transpose. Between kicks the root's
//! link drifts as in flight, its centre of mass in a straight line. So the root's position and velocity within an
//! implicit frame refer to the link's centre of mass ([`centre`]).

use nerd_core::dynamics::{kinematics_about, root_position};

use super::energy::MAX_REFINED;
use crate::prelude::*;

/// Turn (rad) of the root in a substep above which its middle angular velocity is solved for.
pub(super) const FAST_ROOT: f64 = 0.015;
/// Relative tolerance of the middle angular velocity. A smaller tolerance of drags lowers it, at most to
/// `MIN_SPIN_TOLERANCE`.
pub(super) const SPIN_TOLERANCE: f64 = 1e-7;
const MIN_SPIN_TOLERANCE: f64 = 1e-12;
/// Most solves of a substep for its middle angular velocity, added to its other solves.
pub(super) const SPIN_PASSES: usize = 8;

/// Largest turn (rad) of the root in a substep of Runge-Kutta; the energy loss grows with its fifth power.
pub(super) const MAX_ROOT_TURN_RK4: f64 = 0.08;

/// Factor (a power of two) on Runge-Kutta's substeps, for a root that turns by `turn` (rad) in each.
pub(super) fn turns(turn: f64) -> usize {
    let mut times = 1;
    while turn > MAX_ROOT_TURN_RK4 * times as f64 && times < MAX_REFINED {
        times *= 2;
    }
    times
}

/// Centre of mass of a free root's link (m, world axes, from the root) at coordinates `q`.
pub(super) fn arm(robot: &Robot, q: &[f64]) -> Vector3<f64> {
    if robot.floating() { quaternion(&q[3..7]) * robot.links[0].inertia.com } else { Vector3::zeros() }
}

/// Moves a free root's position to its link's centre of mass (`sign` 1), or back (-1).
pub(super) fn centre(robot: &Robot, q: &mut [f64], sign: f64) {
    if robot.floating() {
        let moved = vector(q) + arm(robot, q) * sign;
        q[..3].copy_from_slice(moved.as_slice());
    }
}

/// Kinematics about the centre of mass of the root's link, from coordinates `q` that have the root's position at that
/// centre.
pub(super) fn kinematics_about_com(robot: &Robot, q: &[f64], data: &mut Data) {
    let place = root_position(robot, q);
    kinematics_about(robot, q, &(place + arm(robot, q)), data);
    data.origin = place;
}

/// Newton's method for the middle of a substep of a spinning root.
pub(super) struct Spin {
    /// Inertia of the whole robot about its centre of mass (kg m^2, world axes).
    inertia: Matrix3<f64>,
    h: f64,
    round: f64,
}

impl Spin {
    /// `None` if the root turns by less than [`FAST_ROOT`] over a substep h from local velocities `qd`. `settled`:
    /// tolerance of drags. Needs the links' inertias.
    pub(super) fn of(robot: &Robot, data: &Data, (h, settled): (f64, f64), qd: &[f64]) -> Option<Self> {
        if !robot.floating() || h * vector(qd).norm() <= FAST_ROOT {
            return None;
        }
        let zero = (0.0, Vector3::zeros(), Matrix3::zeros());
        let add = |(mass, moment, inertia), own: &nerd_core::spatial::SpatialInertia| {
            (mass + own.mass, moment + own.moment, inertia + own.inertia)
        };
        let (mass, moment, inertia): (f64, Vector3<f64>, Matrix3<f64>) = data.inertia.iter().fold(zero, add);
        let cross = moment.cross_matrix();
        Some(Self {
            inertia: inertia + cross * cross / mass,
            h,
            round: settled.clamp(MIN_SPIN_TOLERANCE, SPIN_TOLERANCE),
        })
    }

    fn matrix(&self, w: &Vector3<f64>) -> Matrix3<f64> {
        self.inertia + (w.cross_matrix() * self.inertia - (self.inertia * w).cross_matrix()) * (0.5 * self.h)
    }

    /// Next estimate of the middle angular velocity (rad/s) for a substep from `qd`, given the `rate` solved at
    /// `middle`. `None` once `middle` is within tolerance.
    pub(super) fn next(&self, qd: &[f64], middle: &[f64], rate: &[f64]) -> Option<Vector3<f64>> {
        let w = vector(middle);
        let off = vector(qd) + vector(rate) * (0.5 * self.h) - w;
        (off.norm() > self.round * w.norm())
            .then(|| w + self.matrix(&w).lu().solve(&(self.inertia * off)).unwrap_or(off))
    }

    /// Correction of the gradient with respect to the rate, for a remainder `off` in the backward pass.
    pub(super) fn back(&self, middle: &[f64], off: &Vector3<f64>) -> Vector3<f64> {
        self.inertia * self.matrix(&vector(middle)).transpose().lu().solve(off).unwrap_or_else(Vector3::zeros)
    }
}
