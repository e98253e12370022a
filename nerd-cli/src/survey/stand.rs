//! Reports in one line whether a robot stands, hangs or falls. The robot is simulated from its default pose, which an
//! SRDF beside its file may name. Joints are held by drives ([`nerd_sim::drive::holding`]), and in a second rollout
//! limp.

use nerd_sim::drive::holding;
use nerd_sim::scene::{foot, up};
use nerd_sim::system::GROUND;

use crate::mujoco::stand as stood;
use crate::{prelude::*, roll::rolled};

/// Most degrees of freedom of a simulated robot; with more, a simulated second takes seconds.
const MOST: usize = 200;
/// A robot whose root tilts further than this (rad) has fallen.
const TILTED: f64 = 0.35;
/// A robot whose root sinks by more than this fraction of its initial height has fallen.
const LOWER: f64 = 0.2;
/// Largest joint displacement from the default pose (rad or m) that counts as hanging still.
const HELD: f64 = 0.1;

/// Returns the default state; a floating robot is moved so that its lowest contact point touches the ground.
fn set_down(system: &System) -> Vec<f64> {
    let mut state = system.default_state();
    if system.robot.floating() && !system.robot.contact_points.is_empty() {
        let sunk = up(&system.gravity()) * lowest(system, &state);
        (0..3).for_each(|k| state[k] -= sunk[k]);
    }
    state
}

/// Simulates a floating robot for `seconds` here and in MuJoCo, from the default pose under equal drives. Returns our
/// root height above MuJoCo's (m) and the angle between the root orientations (rad). `None` for a fixed base, without
/// contact points, or for more than `MOST` degrees of freedom.
pub(super) fn beside(python: &Path, path: &Path, system: &Arc<System>, seconds: f64) -> Option<Result<[f64; 2]>> {
    let robot = &system.robot;
    let small = robot.nv() <= MOST && robot.floating() && !robot.contact_points.is_empty();
    small.then(|| {
        let state = set_down(system);
        let drives =
            holding(system, &state).into_iter().map(|drive| Drive { effort: f64::INFINITY, ..drive }).collect_vec();
        let theirs = stood(python, path, system, &state, &drives, seconds)?;
        let scene = system.scene(if system.all_scenes().contains(&GROUND) { GROUND } else { "plane" })?;
        let [_, ours] = rolls(system, &scene, &state, &drives, (seconds / system.frame_time).round() as usize)?;
        let turn = quaternion(&ours[3..7]).angle_to(&quaternion(&theirs[3..7]));
        Ok([up(&system.gravity()).dot(&(vector(&ours) - vector(&theirs))), turn])
    })
}

pub fn verdict(system: &Arc<System>, seconds: f64) -> String {
    tried(system, seconds).unwrap_or_else(|reason| format!("{seconds} s of simulation end early: {reason}"))
}

fn tried(system: &Arc<System>, seconds: f64) -> Result<String> {
    let robot = &system.robot;
    let state = set_down(system);
    if robot.nv() > MOST {
        return Ok(format!(
            "whether it stands is not tried: with {} degrees of freedom a second of simulation takes long",
            robot.nv()
        ));
    }
    if robot.floating() && robot.contact_points.is_empty() {
        return Ok("it falls: it has nothing to touch the ground with".into());
    }
    let scene = system.scene(if robot.floating() { "plane" } else { "free" })?;
    let frames = (seconds / system.frame_time).ceil() as usize;
    let after =
        |drives: &[Drive]| rolls(system, &scene, &state, drives, frames).map(|last| ended(system, &state, &last));
    let limp = after(&[])?;
    Ok(match robot.joint_count() {
        0 => format!("after {seconds} s it {limp}"),
        _ => format!(
            "after {seconds} s, joints held by drives, it {}; limp, it {limp}",
            after(&holding(system, &state))?
        ),
    })
}

/// Rolls out `frames` frames with the preset `accurate`, and returns the last two states.
fn rolls(
    system: &Arc<System>,
    scene: &Arc<Scene>,
    state: &[f64],
    drives: &[Drive],
    frames: usize,
) -> Result<[Vec<f64>; 2]> {
    let mut batch = Batch::new(system, scene, 1);
    let mut solver = Articulated::new(ArticulatedConfig::accurate(system));
    batch.reset(0, state);
    batch.drives = drives.to_vec();
    let before = rolled(batch, &mut solver, frames - 1)?;
    let last = rolled(before.clone(), &mut solver, 1)?;
    Ok([before.states, last.states])
}

/// Returns the height of the lowest contact point (m) at `state`.
fn lowest(system: &System, state: &[f64]) -> f64 {
    let robot = &system.robot;
    let mut data = Data::new(&system.robot);
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|p| foot(p, &data, &up(&system.gravity())));
    heights.fold(f64::INFINITY, f64::min)
}

/// Says whether the robot stands, falls, moves or hangs still, with its displacements and velocities in the last frame.
fn ended(system: &System, start: &[f64], [before, last]: &[Vec<f64>; 2]) -> String {
    let robot = &system.robot;
    let coords = robot.root_coords();
    let rates = robot.nq() + robot.root_dofs();
    let unit =
        |k: usize| if robot.joints().nth(k).is_some_and(|j| j.kind == JointKind::Prismatic) { "m" } else { "rad" };
    let name = |k: usize| robot.joints().nth(k).map_or("", |joint| &joint.name);
    let most = |x: Vec<f64>| x.into_iter().map(f64::abs).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let fastest = most(last[rates..].to_vec())
        .map_or(String::new(), |(k, v)| format!(", fastest `{}` at {} {}/s", name(k), digits(v), unit(k)));
    if robot.floating() {
        let up = up(&system.gravity());
        let [from, height] = [start, last].map(|state| up.dot(&vector(state)));
        let tilt = (quaternion(&last[3..7]) * (quaternion(&start[3..7]).inverse() * up)).angle(&up);
        let way = (vector(last) - vector(before)).norm() / system.frame_time;
        let does = if tilt > TILTED || from - height > LOWER * from { "falls" } else { "stands" };
        let degrees = tilt.to_degrees();
        return format!(
            "{does} (root {height:.4} m high, {from:.4} m at the start, tilted by {degrees:.1} deg, at {} m/s{fastest})",
            digits(way)
        );
    }
    let ways = start[coords..].iter().zip(&last[coords..]).zip(robot.joints());
    let gone = most(ways.map(|((from, to), joint)| if joint.wraps() { wrap(to - from) } else { to - from }).collect());
    let Some((k, gone)) = gone else { return "has nothing to move".into() };
    let does = if gone > HELD { "moves" } else { "hangs still" };
    format!("{does} (`{}` is {} {} from its pose{fastest})", name(k), digits(gone), unit(k))
}
