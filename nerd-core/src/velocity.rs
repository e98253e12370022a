//! The two forms of a robot's velocity, as types that cannot be confused.
//!
//! A state `[q, qd]` holds a [`SpatialTwist`]; the dynamics use a [`LocalVelocity`]. The two differ only for a floating
//! root:
//!
//! ```text
//! SpatialTwist    (w, v, joint rates)        v = p_dot + p x w, velocity of the root's material at the origin
//! LocalVelocity   (w, p_dot, joint rates)    velocity of the root at its position p
//! ```
//!
//! Both forms are in world axes (rad/s, m/s). `V` is any container of the `nv` numbers: a `Vec`, an array, a slice.

use crate::prelude::*;

/// Velocity in the form of a state: a floating root's twist about the world's origin, then the joint velocities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialTwist<V>(pub V);

/// Velocity in the form of the dynamics: a floating root's angular velocity and the velocity of its position, then the
/// joint velocities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalVelocity<V>(pub V);

impl Robot {
    /// Splits a state `[q, qd]` into coordinates and velocity.
    pub fn split<'a>(&self, state: &'a [f64]) -> (&'a [f64], SpatialTwist<&'a [f64]>) {
        let (q, qd) = state.split_at(self.nq());
        (q, SpatialTwist(qd))
    }

    /// Like `Self::split`, with mutable parts.
    pub fn split_mut<'a>(&self, state: &'a mut [f64]) -> (&'a mut [f64], SpatialTwist<&'a mut [f64]>) {
        let (q, qd) = state.split_at_mut(self.nq());
        (q, SpatialTwist(qd))
    }
}

impl<V: AsRef<[f64]>> SpatialTwist<V> {
    /// A copy converted to the form of the dynamics, at coordinates `q`.
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

    /// Adds `acceleration[nv]` (rad/s^2, m/s^2) times `time` (s) to the velocity.
    pub fn accelerate<'a>(&mut self, acceleration: impl IntoIterator<Item = &'a f64>, time: f64) {
        self.0.as_mut().iter_mut().zip(acceleration).for_each(|(v, a)| *v += a * time);
    }
}

impl<V: AsRef<[f64]>> LocalVelocity<V> {
    /// Advances the coordinates of a state `[q, qd]` by `time` (s) at this velocity, and stores this velocity in the
    /// state. Angles are not wrapped.
    pub fn advance(&self, robot: &Robot, state: &mut [f64], time: f64) {
        let own = self.0.as_ref();
        let (q, qd) = state.split_at_mut(robot.nq());
        drift(robot, q, own, time);
        qd.copy_from_slice(own);
        to_world(robot, q, qd);
    }
}

/// Advances the coordinates `q` by `time` (s) at constant local velocities `qd`.
#[doc(hidden)]
#[inline]
pub fn drift(robot: &Robot, q: &mut [f64], qd: &[f64], time: f64) {
    q[robot.root_coords()..].iter_mut().zip(&qd[robot.root_dofs()..]).for_each(|(x, v)| *x += v * time);
    if robot.floating() {
        let place = vector(q) + vector(&qd[3..6]) * time;
        let turned = UnitQuaternion::from_scaled_axis(vector(qd) * time) * quaternion(&q[3..7]);
        q[..3].copy_from_slice(place.as_slice());
        write_quaternion(&mut q[3..7], &turned);
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

/// Moves the reference point of a floating root's twist by `by` (m): `v += w x by`.
#[doc(hidden)]
#[inline]
pub fn move_twist(robot: &Robot, by: &Vector3<f64>, qd: &mut [f64]) {
    if robot.floating() {
        let moved = vector(&qd[3..6]) + vector(&qd[..3]).cross(by);
        qd[3..6].copy_from_slice(moved.as_slice());
    }
}

/// World position of the root (m).
#[inline]
pub fn root_position(robot: &Robot, q: &[f64]) -> Vector3<f64> {
    match robot.base {
        Base::Fixed(pose) => pose.translation.vector,
        Base::Floating => vector(&q[..3]),
    }
}
