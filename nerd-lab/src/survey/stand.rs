//! Whether a robot stands, hangs or falls, in a line: a while of simulation from its default pose, which an SRDF beside it may name, each
//! joint held by a drive ([`nerd_sim::drive::holding`]), and the same without.

use nerd_sim::{drive::holding, scene::foot};

use super::each;
use super::robot::{Found, reason};
use crate::mujoco::{Referee, Scheme};
use crate::{prelude::*, roll::rolled};

/// Seconds that each robot of a folder stands.
pub const STANDING: f64 = 10.0;
/// Largest step of MuJoCo beside it (s).
const FINE: f64 = 2.5e-4;
/// Degrees of freedom of which a second takes seconds.
const MOST: usize = 200;
/// Beyond this tilt (rad), or lower by this share of its height, a robot has fallen.
const TILTED: f64 = 0.35;
const LOWER: f64 = 0.2;
/// A joint that is farther (rad or m) from its pose has not been held.
const HELD: f64 = 0.1;

/// Each robot stands and falls; what cannot has a line.
pub fn standing(files: &[Found]) -> Table {
    let rows = each(files, |Found { path, name }| {
        let system = System::named(&path.display().to_string()).map_err(|e| reason(&e, name));
        vec![name.clone(), system.map_or_else(|reason| reason, |system| verdict(&system, STANDING))]
    });
    let note = "On the plane `plane`, preset `accurate`, contact at points of the robot's own collision shapes. Each joint is held by a drive \
                inside the substep, `kp = m g L` with its mass and extent, `kd = kp / 20`, efforts as in its URDF.";
    Table::new("standing", &["file", "what it does"]).with(rows).noted(note)
}

/// Each robot held and limp for a second beside MuJoCo, which has it as we write it, with contacts of its own, at steps of a fraction of a
/// millisecond: how far root and joints are apart then.
pub fn standing_beside(files: &[Found], python: &Path) -> Table {
    let rows = each(files, |Found { path, name }| {
        let tried = System::named(&path.display().to_string())
            .map_err(Error::from)
            .and_then(|system| Ok([secondly(&system, python, true)?, secondly(&system, python, false)?]));
        let words = tried.map_or_else(|e| vec![reason(&format!("{e:#}"), name)], |both| both.concat());
        [name.clone()].into_iter().chain(words).chain(std::iter::repeat("-".into())).take(5).collect()
    });
    let header = ["file", "held: height (m)", "held: joints (rad or m)", "limp: height (m)", "limp: joints (rad or m)"];
    let note = "After a second from the default pose on the plane `plane` (a fixed base: in `free`): difference of the root's height and \
                largest difference of a joint; in brackets how far MuJoCo is from itself at half the step, and how far it has come. Ours: \
                preset `accurate`. Held: as in `--stand`.";
    Table::new("standing_beside_mujoco", &header).with(rows).noted(note)
}

/// Differences from MuJoCo of root and joints after a second, in words.
fn secondly(system: &Arc<System>, python: &Path, held: bool) -> Result<Vec<String>> {
    let (robot, state, frames) = (&system.robot, set_down(system), (1.0 / system.frame_time).ceil() as usize);
    let scene = system.scene(if robot.floating() { "plane" } else { "free" })?;
    let mut batch = Batch::new(system, &scene, 1);
    batch.reset(0, &state);
    batch.drives = if held { holding(system, &state) } else { Vec::new() };
    let substeps = (system.frame_time / FINE).ceil() as usize;
    let mut referee = Referee::new(python, &batch, frames)?;
    let mut last = |substeps| Ok::<_, Error>(referee.play(Scheme::ImplicitFast, substeps, false)?.frames.pop().unwrap_or_default());
    let (theirs, finer) = (last(substeps)?, last(2 * substeps)?);
    let ours = rolled(batch, &mut Articulated::new(ArticulatedConfig::accurate(system)), frames)?.states;
    let height = |state: &[f64]| if robot.floating() { up(system).dot(&vector(state)) } else { 0.0 };
    let most = |a: &[f64], b: &[f64]| {
        let joints = robot.joints().zip(a[robot.root_coords()..].iter().zip(&b[robot.root_coords()..]));
        joints.map(|(joint, (a, b))| if joint.wraps() { wrap(a - b).abs() } else { (a - b).abs() }).fold(0.0, f64::max)
    };
    let word = |far: &dyn Fn(&[f64], &[f64]) -> f64| {
        let [apart, itself, gone] = [&ours, &finer, &state].map(|other| digits(far(other, &theirs).abs()));
        format!("{apart} ({itself}; {gone})")
    };
    Ok(vec![word(&|a, b| height(a) - height(b)), word(&most)])
}

/// The default pose, a free root set on the ground.
fn set_down(system: &System) -> Vec<f64> {
    let mut state = system.default_state();
    if system.robot.floating() && !system.robot.contact_points.is_empty() {
        let sunk = up(system) * lowest(system, &state);
        (0..3).for_each(|k| state[k] -= sunk[k]);
    }
    state
}

/// One line, whatever comes of it.
pub fn verdict(system: &Arc<System>, seconds: f64) -> String {
    tried(system, seconds).unwrap_or_else(|reason| format!("{seconds} s of simulation end early: {reason}"))
}

fn tried(system: &Arc<System>, seconds: f64) -> Result<String> {
    let (robot, state) = (&system.robot, set_down(system));
    if robot.nv() > MOST {
        return Ok(format!("whether it stands is not tried: with {} degrees of freedom a second of simulation takes long", robot.nv()));
    }
    if robot.floating() && robot.contact_points.is_empty() {
        return Ok("it falls: it has nothing to touch the ground with".into());
    }
    let scene = system.scene(if robot.floating() { "plane" } else { "free" })?;
    let frames = (seconds / system.frame_time).ceil() as usize;
    let after = |drives: &[Drive]| rolls(system, &scene, &state, drives, frames).map(|last| ended(system, &state, &last));
    let limp = after(&[])?;
    Ok(match robot.joint_count() {
        0 => format!("after {seconds} s it {limp}"),
        _ => format!("after {seconds} s, joints held by drives, it {}; limp, it {limp}", after(&holding(system, &state))?),
    })
}

/// The last two states of so many frames of the preset `accurate`.
fn rolls(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64], drives: &[Drive], frames: usize) -> Result<[Vec<f64>; 2]> {
    let (mut batch, mut solver) = (Batch::new(system, scene, 1), Articulated::new(ArticulatedConfig::accurate(system)));
    batch.reset(0, state);
    batch.drives = drives.to_vec();
    let before = rolled(batch, &mut solver, frames - 1)?;
    let last = rolled(before.clone(), &mut solver, 1)?;
    Ok([before.states, last.states])
}

/// Against gravity; along z where there is none.
fn up(system: &System) -> Vector3<f64> {
    -system.gravity().try_normalize(0.0).unwrap_or_else(|| -Vector3::z())
}

/// Height of the lowest contact point (m).
fn lowest(system: &System, state: &[f64]) -> f64 {
    let (robot, mut data) = (&system.robot, Data::new(&system.robot));
    kinematics(robot, state, &mut data);
    let heights = robot.contact_points.iter().map(|p| foot(p, &data, &up(system)));
    heights.fold(f64::INFINITY, f64::min)
}

/// What it does, with figures of the last frame.
fn ended(system: &System, start: &[f64], [before, last]: &[Vec<f64>; 2]) -> String {
    let robot = &system.robot;
    let (coords, rates) = (robot.root_coords(), robot.nq() + robot.root_dofs());
    let unit = |k: usize| if robot.joints().nth(k).is_some_and(|j| j.kind == JointKind::Prismatic) { "m" } else { "rad" };
    let name = |k: usize| robot.joints().nth(k).map_or("", |joint| &joint.name);
    let most = |x: Vec<f64>| x.into_iter().map(f64::abs).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let fastest =
        most(last[rates..].to_vec()).map_or(String::new(), |(k, v)| format!(", fastest `{}` at {} {}/s", name(k), digits(v), unit(k)));
    if robot.floating() {
        let up = up(system);
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
