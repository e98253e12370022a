//! Recognises robots that are chains, and stores a chain's constants.

use crate::prelude::*;

/// Axes of the gripper: three slides x, y, z, then yaw, pitch, roll.
const AXES: usize = 6;
/// Largest relative error of a drive's damping against critical damping, which the closed form of `Chain::glide`
/// assumes.
const NEAR: f64 = 0.01;

/// Error that the robot is not a chain.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("robot `{robot}` is not a chain that is learned rod by rod: {reason}")]
pub struct NoChain {
    /// Name of the robot.
    pub robot: String,
    /// Why the robot is not a chain.
    pub reason: String,
}

/// A gripper on six critically damped axes, followed by equal rods on two hinges each (z, then y).
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Number of rods.
    pub rods: usize,
    /// Length of a rod (m).
    pub length: f64,
    /// Radius of the contact points (m).
    pub radius: f64,
    /// Length of a frame (s).
    pub frame_time: f64,
    /// Position of the gripper at zero coordinates (m, world).
    pub home: Vector3<f64>,
    /// Stiffness of the gripper's axes (N/m, N m/rad).
    pub stiffness: [f64; AXES],
    /// Natural frequency of the gripper's axes (rad/s), `sqrt(stiffness / armature)`.
    pub pulse: [f64; AXES],
}

impl Chain {
    /// The chain of a system; an error if its robot is not a chain.
    pub fn of(system: &System) -> Result<Self, NoChain> {
        Self::read(system).map_err(|reason| NoChain { robot: system.name.clone(), reason })
    }

    fn read(system: &System) -> Result<Self, String> {
        let robot = &system.robot;
        let home = match &robot.base {
            Base::Fixed(at) if at.rotation.angle() < 1e-12 => at.translation.vector,
            _ => return Err("its base is free or turned; `support = \"gripper\"` is needed".into()),
        };
        let gravity = system.gravity();
        if gravity.x != 0.0 || gravity.y != 0.0 {
            return Err("gravity is not along z".into());
        }
        let joints: Vec<&Joint> = robot.links.iter().filter_map(|link| link.joint.as_ref()).collect();
        let in_line = robot.links.iter().enumerate().all(|(i, link)| link.parent == i.checked_sub(1));
        if robot.mimics() || !in_line || joints.len() < AXES + 4 || !joints.len().is_multiple_of(2) {
            return Err(
                "a gripper's six axes and at least two rods on two hinges each, one behind the other, are needed"
                    .into(),
            );
        }
        let length = joints[AXES + 2].origin().translation.vector.x;
        joints.iter().enumerate().try_for_each(|(i, joint)| fits(i, joint, length))?;
        let rods = (joints.len() - AXES) / 2;
        let radius = radius(robot, rods, length)?;
        let stiffness = std::array::from_fn(|k| joints[k].stiffness);
        let pulse = std::array::from_fn(|k| (joints[k].stiffness / joints[k].armature).sqrt());
        Ok(Self { rods, length, radius, frame_time: system.frame_time, home, stiffness, pulse })
    }

    /// Whether the chain's motion is symmetric about the z axis, because the drives of x and y are equal.
    pub fn round(&self) -> bool {
        self.stiffness[0] == self.stiffness[1] && self.pulse[0] == self.pulse[1]
    }
}

/// Refuses a joint that cannot be the i-th of a chain with rods of this length.
fn fits(i: usize, joint: &Joint, length: f64) -> Result<(), String> {
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let axis = if i < AXES { [x, y, z, z, y, x][i] } else { [z, y][i % 2] };
    let ahead = if i > AXES && i.is_multiple_of(2) { x * length } else { Vector3::zeros() };
    let is = (joint.kind == JointKind::Prismatic) == (i < 3)
        && joint.limit.is_none()
        && (joint.axis().into_inner() - axis).norm() < 1e-12
        && (joint.origin().translation.vector - ahead).norm() < 1e-9
        && joint.origin().rotation.angle() < 1e-12;
    let critical = 2.0 * (joint.armature * joint.stiffness).sqrt();
    let driven = joint.rest == 0.0 && critical > 0.0 && (joint.damping / critical - 1.0).abs() < NEAR;
    let reason = match i < AXES {
        true if !is => "is not one of a gripper's axes x, y, z, yaw, pitch, roll in this order",
        true if !driven => "is driven by no critically damped spring about 0",
        false if !is || length <= 0.0 => "is not a hinge of a rod: z, then y, along x, no twist, equal lengths",
        _ => return Ok(()),
    };
    Err(format!("joint `{}` {reason}", joint.name))
}

/// Radius of the contact points: one at the end of each rod, all equal.
fn radius(robot: &Robot, rods: usize, length: f64) -> Result<f64, String> {
    let points = &robot.contact_points;
    let fits = |(k, p): (usize, &nerd_core::contact::ContactPoint)| {
        p.link == AXES + 2 * k + 1 && (p.local - Vector3::x() * length).norm() < 1e-9 && p.radius == points[0].radius
    };
    match points.len() == rods && points.iter().enumerate().all(fits) && points[0].radius > 0.0 {
        true => Ok(points[0].radius),
        false => Err("a contact point at the end of each rod, all of one radius, is needed".into()),
    }
}
