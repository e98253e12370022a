//! Whether a robot stands, from its URDF alone: on its own geometry, on a plane, each joint held by a drive
//! ([`nerd_sim::drive::holding`]); and whether it falls as a body falls when nothing holds it. MuJoCo stands beside it where there is one.

use std::path::Path;
use std::sync::Arc;

use anyhow::Error;
use nalgebra::Vector3;
use nerd_core::contact::ContactPoint;
use nerd_core::dynamics::{Data, point_position, totals};
use nerd_core::state::quaternion;
use nerd_sim::drive::holding;
use nerd_sim::prelude::*;
use nerd_sim::system::pose_of;

use super::file::{Found, reason, text};
use crate::error::{Result, refuse};
use crate::mujoco::{Referee, Scheme};

/// Frames of a rollout: ten seconds at sixty a second.
pub const STANDING: usize = 600;

/// The robot's root over the frames of a rollout.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// Height over the plane (m).
    pub height: Vec<f64>,
    /// Angle (rad) between its up axis and where that was at the start.
    pub tilt: Vec<f64>,
}

/// What came of a file.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Where its pose is from.
    pub pose: String,
    /// Contact points.
    pub points: usize,
    /// Stiffness of the drives (N m/rad or N/m).
    pub kp: f64,
    /// Height of the root at the start (m), its lowest contact point on the plane.
    pub start: f64,
    /// In `articulated`.
    pub ours: Course,
    /// In MuJoCo, on the same bodies, points and drives.
    pub mujoco: Option<Course>,
    /// With nothing held.
    pub limp: Limp,
}

/// A fall.
#[derive(Clone, Copy, Debug)]
pub struct Limp {
    /// Energy lost from the first frame to the last (J).
    pub lost: f64,
    /// Most that the energy, with what springs of contacts and limits hold, rose over that of any frame before (J).
    pub rise: f64,
    /// Deepest that a contact point came below the plane (m).
    pub deepest: f64,
}

/// A robot at the start of the standing test.
pub(super) struct Ready {
    pub(super) system: Arc<System>,
    /// At rest, its lowest contact point on the plane.
    pub(super) state: Vec<f64>,
    /// Where its pose is from.
    pub(super) pose: String,
    pub(super) drives: Vec<Drive>,
}

/// Reads a robot and puts it on its feet.
pub(super) fn ready(found: &Found) -> Result<Ready> {
    let system = System::bare_at(&found.name, &text(&found.path).map_err(Error::msg)?, true, Some(&found.path));
    let system = Arc::new(system.map_err(|e| Error::msg(reason(&e, &found.name)))?);
    if system.robot.contact_points.is_empty() {
        refuse!("has nothing to touch the ground with");
    }
    let (mut state, pose) = pose_of(&system.robot, Some(&found.path));
    let low = lowest(&system, &state);
    state[2] -= low;
    let drives = holding(&system, &state);
    Ok(Ready { system, state, pose, drives })
}

/// Lets a robot stand, and fall. Its pose is that of an SRDF in `../srdf` (`standing` or `half_sitting`), else zero within the limits.
///
/// # Errors
/// If it cannot be read, touches nothing, cannot be stepped, or MuJoCo does not answer.
pub fn stand(found: &Found, python: Option<&Path>) -> Result<Standing> {
    let Ready { system, state, pose, drives } = ready(found)?;
    let scene = system.scene("plane").map_err(|e| Error::msg(reason(&e, &found.name)))?;
    let roll = |drives: &[Drive]| -> Result<Vec<Vec<f64>>> {
        let mut batch = Batch::new(&system, &scene, 1);
        batch.reset(0, &state);
        batch.drives = drives.to_vec();
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        let tau = vec![0.0; system.robot.joint_count()];
        let mut frame = || solver.step(&mut batch, &tau).map(|()| batch.states.clone()).map_err(Error::from);
        (0..STANDING).map(|_| frame()).collect()
    };
    let ours = roll(&drives)?;
    let limp = limp(&system, &state, &roll(&[])?);
    let mujoco = python.map(|python| -> Result<_> {
        let mut batch = Batch::new(&system, &scene, 1);
        batch.reset(0, &state);
        batch.drives.clone_from(&drives);
        let mut referee = Referee::of(python, &batch, STANDING)?;
        Ok(course(&state, &referee.play(Scheme::ImplicitFast, 2 * system.spec.substeps, false)?.frames))
    });
    Ok(Standing {
        pose,
        points: system.robot.contact_points.len(),
        kp: drives.first().map_or(0.0, |d| d.kp),
        start: state[2],
        ours: course(&state, &ours),
        mujoco: mujoco.transpose()?,
        limp,
    })
}

fn course(start: &[f64], frames: &[Vec<f64>]) -> Course {
    let up = |state: &[f64]| quaternion(&state[3..7]) * (quaternion(&start[3..7]).inverse() * Vector3::z());
    Course { height: frames.iter().map(|state| state[2]).collect(), tilt: frames.iter().map(|state| up(state).angle(&up(start))).collect() }
}

/// What the springs of contacts and limits hold (J); `data` has the kinematics.
fn held(system: &System, state: &[f64], data: &Data) -> f64 {
    let robot = &system.robot;
    let spring = |stiffness: f64, way: f64| 0.5 * stiffness * way.min(0.0).powi(2);
    let gap = |p: &ContactPoint| point_position(data, p.link, &p.local).z - p.radius;
    let touching: f64 = robot.contact_points.iter().map(|p| spring(system.spec.material.stiffness, gap(p))).sum();
    let limits = robot.joints().zip(&state[robot.root_coords()..]).filter_map(|(joint, q)| {
        let limit = joint.limit?;
        Some(spring(limit.stiffness, q - limit.lower) + spring(limit.stiffness, limit.upper - q))
    });
    touching + limits.sum::<f64>()
}

/// Height of the lowest contact point (m).
pub(super) fn lowest(system: &System, state: &[f64]) -> f64 {
    let (robot, mut data) = (&system.robot, Data::new(&system.robot));
    nerd_core::dynamics::kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local).z - p.radius);
    heights.fold(f64::INFINITY, f64::min)
}

fn limp(system: &System, start: &[f64], frames: &[Vec<f64>]) -> Limp {
    let mut data = Data::new(&system.robot);
    let mut energy = |state: &[f64]| {
        let moving = totals(&system.robot, state, &mut data).energy(&system.gravity());
        moving + held(system, state, &data)
    };
    let energies: Vec<f64> = std::iter::once(start).chain(frames.iter().map(Vec::as_slice)).map(&mut energy).collect();
    let mut least = f64::INFINITY;
    let rise = energies.iter().fold(0.0, |rise: f64, e| {
        least = least.min(*e);
        rise.max(e - least)
    });
    let deepest = frames.iter().map(|state| -lowest(system, state)).fold(0.0, f64::max);
    Limp { lost: energies[0] - energies[energies.len() - 1], rise, deepest }
}
