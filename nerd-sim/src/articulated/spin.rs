//! The spin of a free root, which the middle of a kick shares with both its ends.
//!
//! The gyroscopic torque of a substep is that of its middle, `- w x I w` with `w = (w_0 + w_1) / 2`. Of the true mean it does no work, at any
//! length of the substep: `w . (I (w_1 - w_0)) = - h w . (w x I w) = 0`. A mean that was only foreseen, from the rate of the substep before, drives a
//! body that flies. So where a root turns by [`SPUN`] in a substep its mean is found by Newton's method, with the inertia I of the whole robot, held
//! as it is, about its centre of mass: with `off = (w_0 + h a / 2) - w` for the acceleration a that was solved with w,
//!
//! ```text
//! (I + h/2 ([w] I - [I w])) change = I off
//! ```
//!
//! which is exact for one link that nothing touches, and the same transposed on the way back. In between the root's link drifts as what flies does,
//! its centre of mass straight ahead: the coordinates and velocity of an implicit frame are that place's, not the root's ([`centre`]).

use nerd_core::dynamics::{kinematics_about, root_position};

use super::energy::FINEST;
use crate::prelude::*;

/// Turn (rad) of a root in a substep from which on its middle is found.
pub(super) const SPUN: f64 = 0.015;
/// How far, of the spin, its middle may be from the mean; less where drags are to be settled further than that, to what rounding leaves.
pub(super) const ROUND: f64 = 1e-7;
const ROUNDEST: f64 = 1e-12;
/// Solves of a substep at most beside those that it takes anyway.
pub(super) const SPIN_PASSES: usize = 8;

/// Turn (rad) of a root in a substep of Runge-Kutta at most, which loses energy with its fifth power.
pub(super) const SPUN_RK4: f64 = 0.08;

/// Times as many substeps of Runge-Kutta as would have a root turn by so much (rad): a power of 2.
pub(super) fn turns(turn: f64) -> usize {
    let mut times = 1;
    while turn > SPUN_RK4 * times as f64 && times < FINEST {
        times *= 2;
    }
    times
}

/// The centre of mass of a free root's link (m, world axes, from the root) at coordinates `q`.
pub(super) fn arm(robot: &Robot, q: &[f64]) -> Vector3<f64> {
    if robot.floating() { quaternion(&q[3..7]) * robot.links[0].inertia.com } else { Vector3::zeros() }
}

/// Moves the place of a free root to its link's centre of mass, or back.
pub(super) fn centre(robot: &Robot, q: &mut [f64], sign: f64) {
    if robot.floating() {
        let moved = vector(q) + arm(robot, q) * sign;
        q[..3].copy_from_slice(moved.as_slice());
    }
}

/// Kinematics of a robot whose root is told by its link's centre of mass, and from there.
pub(super) fn stand(robot: &Robot, q: &[f64], data: &mut Data) {
    let place = root_position(robot, q);
    kinematics_about(robot, q, &(place + arm(robot, q)), data);
    data.origin = place;
}

/// A root that spins.
pub(super) struct Spin {
    /// Inertia of the whole robot about its centre of mass, world axes.
    inertia: Matrix3<f64>,
    h: f64,
    round: f64,
}

impl Spin {
    /// None of a root that turns by less over a substep h that begins at local velocities `qd`, with drags to be settled to such a share. Needs the
    /// links' inertias.
    pub(super) fn of(robot: &Robot, data: &Data, (h, settled): (f64, f64), qd: &[f64]) -> Option<Self> {
        if !robot.floating() || h * vector(qd).norm() <= SPUN {
            return None;
        }
        let zero = (0.0, Vector3::zeros(), Matrix3::zeros());
        let add = |(mass, moment, inertia), own: &nerd_core::spatial::SpatialInertia| {
            (mass + own.mass, moment + own.moment, inertia + own.inertia)
        };
        let (mass, moment, inertia): (f64, Vector3<f64>, Matrix3<f64>) = data.inertia.iter().fold(zero, add);
        let cross = moment.cross_matrix();
        Some(Self { inertia: inertia + cross * cross / mass, h, round: settled.clamp(ROUNDEST, ROUND) })
    }

    fn matrix(&self, w: &Vector3<f64>) -> Matrix3<f64> {
        self.inertia + (w.cross_matrix() * self.inertia - (self.inertia * w).cross_matrix()) * (0.5 * self.h)
    }

    /// The middle of a substep that began at `qd`, by the middle that gave a rate; none where that was near enough.
    pub(super) fn next(&self, qd: &[f64], middle: &[f64], rate: &[f64]) -> Option<Vector3<f64>> {
        let w = vector(middle);
        let off = vector(qd) + vector(rate) * (0.5 * self.h) - w;
        (off.norm() > self.round * w.norm()).then(|| w + self.matrix(&w).lu().solve(&(self.inertia * off)).unwrap_or(off))
    }

    /// A change of the gradient by the rate that what is left of `off` asks for on the way back.
    pub(super) fn back(&self, middle: &[f64], off: &Vector3<f64>) -> Vector3<f64> {
        self.inertia * self.matrix(&vector(middle)).transpose().lu().solve(off).unwrap_or_else(Vector3::zeros)
    }
}
