//! The two forms of a robot's velocity, as types that cannot be confused.
//!
//! A state `[q, qd]` holds a [`SpatialTwist`]; the dynamics work on a [`LocalVelocity`]. They differ for a floating root alone:
//!
//! ```text
//! SpatialTwist    (w, v, joint rates)        v = p_dot + p x w, the velocity of the root's material at the world's origin
//! LocalVelocity   (w, p_dot, joint rates)    the velocity of the root's own origin p
//! ```
//!
//! Both are in world axes. Either wraps whatever holds the numbers: a `Vec`, an array, a slice.

use crate::prelude::*;

/// Velocity in the form of a state: a floating root's twist about the world's origin, then the joints' rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialTwist<V>(pub V);

/// Velocity in the form of the dynamics: a floating root's angular velocity and its origin's velocity, then the joints' rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalVelocity<V>(pub V);

impl Robot {
    /// Coordinates and velocity of a state `[q, qd]`.
    pub fn split<'a>(&self, state: &'a [f64]) -> (&'a [f64], SpatialTwist<&'a [f64]>) {
        let (q, qd) = state.split_at(self.nq());
        (q, SpatialTwist(qd))
    }

    /// The same, to be written.
    pub fn split_mut<'a>(&self, state: &'a mut [f64]) -> (&'a mut [f64], SpatialTwist<&'a mut [f64]>) {
        let (q, qd) = state.split_at_mut(self.nq());
        (q, SpatialTwist(qd))
    }
}

impl<V: AsRef<[f64]>> SpatialTwist<V> {
    /// A copy in the form of the dynamics, at coordinates `q`.
    pub fn to_local(&self, robot: &Robot, q: &[f64]) -> LocalVelocity<Vec<f64>> {
        SpatialTwist(self.0.as_ref().to_vec()).into_local(robot, q)
    }
}

impl<V: AsMut<[f64]>> SpatialTwist<V> {
    /// Converts to the form of the dynamics in place, at coordinates `q`.
    pub fn into_local(mut self, robot: &Robot, q: &[f64]) -> LocalVelocity<V> {
        to_local(robot, q, self.0.as_mut());
        LocalVelocity(self.0)
    }
}

impl<V: AsMut<[f64]>> LocalVelocity<V> {
    /// Converts to the form of a state in place, at coordinates `q`.
    pub fn into_twist(mut self, robot: &Robot, q: &[f64]) -> SpatialTwist<V> {
        to_world(robot, q, self.0.as_mut());
        SpatialTwist(self.0)
    }

    /// Adds `time` (s) of acceleration.
    pub fn accelerate<'a>(&mut self, acceleration: impl IntoIterator<Item = &'a f64>, time: f64) {
        self.0.as_mut().iter_mut().zip(acceleration).for_each(|(v, a)| *v += a * time);
    }
}

impl<V: AsRef<[f64]>> LocalVelocity<V> {
    /// Advances a state by `time` (s) at this velocity, which it then has. Endless angles are not wrapped.
    pub fn advance(&self, robot: &Robot, state: &mut [f64], time: f64) {
        let (own, (q, qd)) = (self.0.as_ref(), state.split_at_mut(robot.nq()));
        q[robot.root_coords()..].iter_mut().zip(&own[robot.root_dofs()..]).for_each(|(x, v)| *x += v * time);
        if robot.floating() {
            let place = vector(q) + vector(&own[3..6]) * time;
            let turned = UnitQuaternion::from_scaled_axis(vector(own) * time) * quaternion(&q[3..7]);
            q[..3].copy_from_slice(place.as_slice());
            write_quaternion(&mut q[3..7], &turned);
        }
        qd.copy_from_slice(own);
        to_world(robot, q, qd);
    }
}

/// Converts a twist about the world's origin to the local form in place: `p_dot = v + w x p`.
#[doc(hidden)]
#[inline]
pub fn to_local(robot: &Robot, q: &[f64], qd: &mut [f64]) {
    move_twist(robot, &root_position(robot, q), qd);
}

/// The inverse of [`to_local`]: `v = p_dot - w x p`.
#[doc(hidden)]
#[inline]
pub fn to_world(robot: &Robot, q: &[f64], qd: &mut [f64]) {
    move_twist(robot, &-root_position(robot, q), qd);
}

/// A floating root's twist about an origin that is `by` (m) from the present one: `v += w x by`.
#[doc(hidden)]
#[inline]
pub fn move_twist(robot: &Robot, by: &Vector3<f64>, qd: &mut [f64]) {
    if robot.floating() {
        let moved = vector(&qd[3..6]) + vector(&qd[..3]).cross(by);
        qd[3..6].copy_from_slice(moved.as_slice());
    }
}

/// Where the root is in the world (m).
#[inline]
pub fn root_position(robot: &Robot, q: &[f64]) -> Vector3<f64> {
    match robot.base {
        Base::Fixed(pose) => pose.translation.vector,
        Base::Floating => vector(&q[..3]),
    }
}
