//! Whether a robot stands, hangs or falls, in a line for who has just written its file: a second of simulation from its default pose, each
//! joint held by a drive ([`nerd_sim::drive::holding`]), and the same without.

use nerd_core::robot::JointKind;
use nerd_core::state::{quaternion, vector, wrap};
use nerd_sim::drive::holding;

use super::stand::{lowest, rolls, up};
use crate::prelude::*;

/// Degrees of freedom of which a second takes seconds.
const MOST: usize = 200;
/// Beyond this tilt (rad), or lower by this share of its height, a robot has fallen.
const TILTED: f64 = 0.35;
const LOWER: f64 = 0.2;
/// A joint that is farther (rad or m) from its pose has not been held.
const HELD: f64 = 0.1;

/// One line, whatever comes of it.
pub fn verdict(system: &Arc<System>) -> String {
    tried(system).unwrap_or_else(|reason| format!("a second of simulation ends early: {reason}"))
}

fn tried(system: &Arc<System>) -> Result<String> {
    let (robot, mut state) = (&system.robot, system.default_state());
    if robot.nv() > MOST {
        return Ok(format!("whether it stands is not tried: with {} degrees of freedom a second of simulation takes long", robot.nv()));
    }
    if robot.floating() {
        if robot.contact_points.is_empty() {
            return Ok("it falls: it has nothing to touch the ground with".into());
        }
        let sunk = up(system) * lowest(system, &state);
        (0..3).for_each(|k| state[k] -= sunk[k]);
    }
    let scene = system.scene(if robot.floating() { "plane" } else { "free" })?;
    let frames = (1.0 / system.frame_time).ceil() as usize;
    let after = |drives: &[Drive]| rolls(system, &scene, &state, drives, frames).map(|frames| ended(system, &state, &frames));
    let limp = after(&[])?;
    Ok(match robot.joint_count() {
        0 => format!("after a second it {limp}"),
        _ => format!("after a second, joints held by drives, it {}; limp, it {limp}", after(&holding(system, &state))?),
    })
}

/// What it does, with figures of the last frame.
fn ended(system: &System, start: &[f64], frames: &[Vec<f64>]) -> String {
    let (robot, [.., last]) = (&system.robot, frames) else { return String::new() };
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
        let way = (vector(last) - vector(&frames[frames.len().saturating_sub(2)])).norm() / system.frame_time;
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
