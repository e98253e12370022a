//! Whether a robot stands, from its URDF alone: on its own geometry, on a plane, each joint held by a drive
//! ([`nerd_sim::drive::holding`]); and whether it falls as a body falls when nothing holds it. MuJoCo stands beside it where there is one.

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, totals};
use nerd_core::state::quaternion;
use nerd_sim::drive::holding;
use nerd_sim::scene::foot;
use nerd_sim::suite::rise;
use nerd_sim::system::pose_of;

use super::each;
use super::file::{Found, reason, text};
use crate::mujoco::{Referee, Scheme};
use crate::prelude::*;

/// Frames of a rollout: ten seconds at sixty a second.
pub const STANDING: usize = 600;
/// Every 100th frame is in the table of courses.
const EVERY: usize = 100;

/// The root by frame: its height over the plane (m), and the angle (rad) between its up axis and where that was at the start.
pub type Course = Vec<[f64; 2]>;

#[derive(Clone, Debug)]
pub struct Standing {
    pub pose: String,
    pub points: usize,
    /// Stiffness of the drives (N m/rad or N/m).
    kp: f64,
    /// Height of the root at the start (m), its lowest contact point on the plane.
    pub start: f64,
    pub ours: Course,
    /// In MuJoCo, on the same bodies, points and drives; or why it refuses them.
    pub mujoco: Option<Result<Course, String>>,
    pub limp: Limp,
}

#[derive(Clone, Copy, Debug)]
pub struct Limp {
    /// Energy lost from the first frame to the last (J).
    pub lost: f64,
    /// Most that the energy, with what springs of contacts and limits hold, rose over that of any frame before (J).
    pub rise: f64,
    /// Deepest that a contact point came below the plane (m).
    pub deepest: f64,
}

pub(super) struct Ready {
    pub system: Arc<System>,
    /// At rest, its lowest contact point on the plane.
    pub state: Vec<f64>,
    pose: String,
    pub drives: Vec<Drive>,
}

pub(super) fn ready(found: &Found) -> Result<Ready> {
    let system = System::bare_at(&found.name, &text(&found.path).map_err(Error::msg)?, true, Some(&found.path));
    let system = Arc::new(system.map_err(|e| Error::msg(reason(&e, &found.name)))?);
    if system.robot.contact_points.is_empty() {
        bail!("has nothing to touch the ground with");
    }
    let (mut state, pose) = pose_of(&system.robot, Some(&found.path));
    state[2] -= lowest(&system, &state);
    let drives = holding(&system, &state);
    Ok(Ready { system, state, pose, drives })
}

/// Lets a robot stand, and fall. Its pose is that of an SRDF in `../srdf` (`standing` or `half_sitting`), else zero within the limits.
pub fn stand(found: &Found, python: Option<&Path>) -> Result<Standing> {
    let Ready { system, state, pose, drives } = ready(found)?;
    let scene = system.scene("plane").map_err(|e| Error::msg(reason(&e, &found.name)))?;
    let roll = |drives: &[Drive]| rolls(&system, &scene, &state, drives, STANDING);
    let (ours, limp) = (course(&state, &roll(&drives)?), limp(&system, &scene, &state, &roll(&[])?));
    let mujoco = python.map(|python| -> Result<_> {
        let mut referee = Referee::new(python, &begin(&system, &scene, &state, &drives), STANDING)?;
        Ok(course(&state, &referee.play(Scheme::ImplicitFast, 2 * system.spec.substeps, false)?.frames))
    });
    let (points, kp) = (system.robot.contact_points.len(), drives.first().map_or(0.0, |d| d.kp));
    Ok(Standing { pose, points, kp, start: state[2], ours, mujoco: mujoco.map(|course| course.map_err(|e| format!("{e:#}"))), limp })
}

fn begin(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64], drives: &[Drive]) -> Batch {
    let mut batch = Batch::new(system, scene, 1);
    batch.reset(0, state);
    batch.drives = drives.to_vec();
    batch
}

/// States after each frame of the preset `accurate`.
pub(super) fn rolls(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64], drives: &[Drive], frames: usize) -> Result<Vec<Vec<f64>>> {
    let (mut batch, mut solver) = (begin(system, scene, state, drives), Articulated::new(ArticulatedConfig::accurate(system)));
    let tau = vec![0.0; system.robot.joint_count()];
    let mut frame = || solver.step(&mut batch, &tau).map(|()| batch.states.clone()).map_err(Error::from);
    (0..frames).map(|_| frame()).collect()
}

fn course(start: &[f64], frames: &[Vec<f64>]) -> Course {
    let up = |state: &[f64]| quaternion(&state[3..7]) * (quaternion(&start[3..7]).inverse() * Vector3::z());
    frames.iter().map(|state| [state[2], up(state).angle(&up(start))]).collect()
}

/// Against gravity; along z where there is none.
pub(super) fn up(system: &System) -> Vector3<f64> {
    -system.gravity().try_normalize(0.0).unwrap_or_else(|| -Vector3::z())
}

/// Height of the lowest contact point (m).
pub(super) fn lowest(system: &System, state: &[f64]) -> f64 {
    let (robot, mut data) = (&system.robot, Data::new(&system.robot));
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|p| foot(p, &data, &up(system)));
    heights.fold(f64::INFINITY, f64::min)
}

fn limp(system: &System, scene: &Scene, start: &[f64], frames: &[Vec<f64>]) -> Limp {
    let mut data = Data::new(&system.robot);
    let mut energy =
        |state: &[f64]| totals(&system.robot, state, &mut data).energy(&system.gravity()) + system.stored(scene, state, &mut data);
    let energies: Vec<f64> = std::iter::once(start).chain(frames.iter().map(Vec::as_slice)).map(&mut energy).collect();
    let deepest = frames.iter().map(|state| -lowest(system, state)).fold(0.0, f64::max);
    Limp { lost: energies[0] - energies[energies.len() - 1], rise: rise(energies), deepest }
}

/// Each robot stands and falls; what cannot has a line.
pub fn standing(files: &[Found], mujoco: Option<&Path>) -> Vec<Table> {
    let header = [
        "file",
        "pose",
        "points",
        "kp (N m/rad)",
        "height at the start (m)",
        "after ten seconds (m)",
        "MuJoCo (m)",
        "tilt (deg)",
        "MuJoCo (deg)",
        "limp: lost (J)",
        "energy rose by (J)",
        "deepest point (mm)",
    ];
    let mut courses = Vec::new();
    let rows = each(files, |file| match stand(file, mujoco) {
        Ok(standing) => {
            courses.extend((EVERY - 1..STANDING).step_by(EVERY).map(|frame| {
                let seconds = format!("{:.1}", (frame + 1) as f64 / 60.0);
                [vec![file.name.clone(), seconds], standing.at(frame)].concat()
            }));
            standing.row(&file.name)
        }
        Err(reason) => {
            let mut line = vec![file.name.clone(), reason.to_string()];
            line.resize(header.len(), String::new());
            line
        }
    });
    let note = "Ten seconds on the plane `plane`, preset `accurate`, contact at points of the robot's own collision shapes. Each joint is held \
        by a drive inside the substep, `kp = m g L` with its mass and extent, `kd = kp / 20`, efforts as in its URDF; MuJoCo has the same \
        bodies, points and drives as MJCF, its own contacts (impratio 100, so that feet do not creep), IMPLICITFAST, 32 steps a frame. \
        Height of the root, tilt from the start. Limp: the same without drives; how much the energy, with what springs of contacts and \
        limits hold, rose at most over that of any earlier frame.";
    let over_time = ["file", "seconds", "height (m)", "MuJoCo (m)", "tilt (deg)", "MuJoCo (deg)"];
    vec![
        Table::new("standing", &header).with(rows).noted(note),
        Table::new("courses", &over_time).with(courses).noted("The same over time."),
    ]
}

impl Standing {
    fn row(&self, name: &str) -> Vec<String> {
        let Self { pose, points, kp, start, limp, .. } = self;
        let head = vec![name.into(), pose.clone(), points.to_string(), digits(*kp), format!("{start:.4}")];
        let fall = vec![digits(limp.lost), digits(limp.rise), format!("{:.2}", 1e3 * limp.deepest)];
        [head, self.at(STANDING - 1), fall].concat()
    }

    /// Heights, then tilts, at a frame, ours before MuJoCo's.
    fn at(&self, frame: usize) -> Vec<String> {
        let theirs = self.mujoco.as_ref().and_then(|course| course.as_ref().ok());
        let courses = [Some(&self.ours), theirs].map(|course| course.and_then(|course| course.get(frame)));
        let mut heights = courses.map(|at| or_dash(at.map(|at| format!("{:.4}", at[0]))));
        if let Some(Err(reason)) = &self.mujoco {
            heights[1].clone_from(reason);
        }
        let tilts = courses.map(|at| or_dash(at.map(|at| format!("{:.2}", at[1].to_degrees()))));
        [heights, tilts].concat()
    }
}
