//! Joints, frames and contact forces of an environment by name.

use nalgebra::{Isometry3, Vector3};
use nerd_core::robot::UnknownName;
use nerd_core::spatial::Motion;
use nerd_core::state::write_quaternion;
use nerd_core::velocity::LocalVelocity;

use super::Batch;

/// Why a batch cannot say or do what it is asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// The robot has no such part.
    #[error(transparent)]
    Name(#[from] UnknownName),
    /// The last frame left no forces.
    #[error(
        "no contact forces are known: step a frame with a solver whose capabilities include them (articulated; on a card after `watch`)"
    )]
    NoForces,
    /// A fixed base does not move.
    #[error("the base of robot `{0}` is fixed: it has no pose to set")]
    Fixed(String),
}

impl Batch {
    /// Position (rad or m) and velocity (rad/s or m/s) of a joint.
    pub fn joint(&self, env: usize, name: &str) -> Result<[f64; 2], UnknownName> {
        let (at, nq) = (self.system.robot.joint(name)?, self.system.robot.nq());
        Ok([self.state(env)[at.q], self.state(env)[nq + at.qd]])
    }

    /// Sets them. Of a run that goes on, tell the solver ([`crate::solver::Solver::reset`]).
    pub fn set_joint(&mut self, env: usize, name: &str, [position, velocity]: [f64; 2]) -> Result<(), UnknownName> {
        let (at, nq) = (self.system.robot.joint(name)?, self.system.robot.nq());
        let state = self.state_mut(env);
        (state[at.q], state[nq + at.qd]) = (position, velocity);
        Ok(())
    }

    /// Where a link or a frame (sole, tool) is in the world.
    pub fn pose(&self, env: usize, name: &str) -> Result<Isometry3<f64>, UnknownName> {
        let robot = &self.of(env).robot;
        Ok(robot.pose(self.state(env), &robot.frame(name)?))
    }

    /// Angular velocity (rad/s) of a link or a frame, and velocity (m/s) of its origin, world axes.
    pub fn velocity(&self, env: usize, name: &str) -> Result<Motion, UnknownName> {
        let robot = &self.of(env).robot;
        let (q, qd) = robot.split(self.state(env));
        Ok(robot.velocity(q, &qd.to_local(robot, q), &robot.frame(name)?))
    }

    /// Puts a free root at a pose, with an angular velocity and a velocity of its origin, world axes. Of a run that goes on, tell the
    /// solver ([`crate::solver::Solver::reset`]).
    pub fn set_root(&mut self, env: usize, pose: &Isometry3<f64>, velocity: Motion) -> Result<(), BatchError> {
        let system = self.system.clone();
        let robot = &system.robot;
        if !robot.floating() {
            return Err(BatchError::Fixed(robot.name.clone()));
        }
        let (q, qd) = robot.split_mut(self.state_mut(env));
        q[..3].copy_from_slice(pose.translation.vector.as_slice());
        write_quaternion(&mut q[3..7], &pose.rotation);
        qd.0[..6].copy_from_slice(velocity.vector().as_slice());
        LocalVelocity(qd.0).into_twist(robot, q);
        Ok(())
    }

    /// Mean force (N) of the scene on a moving link in the last frame, world axes.
    pub fn contact_force(&self, env: usize, link: &str) -> Result<Vector3<f64>, BatchError> {
        let robot = &self.system.robot;
        let link = robot.link(link)?;
        if self.forces.is_empty() && !robot.contact_points.is_empty() {
            return Err(BatchError::NoForces);
        }
        let points = robot.contact_points.iter().zip(self.forces_on(env));
        Ok(points.filter(|(point, _)| point.link == link).map(|(_, force)| force).sum())
    }
}
