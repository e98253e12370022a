//! Text of the kernels for episodes on a device: starts and the robot's own controller.

use super::own::Own;
use super::program::{Reach, Real, functions};
use super::records::alone;
use super::text::{Text, number};
use crate::disturb::{NOISES, PUSHES, blocks, every, level};
use crate::prelude::*;
use crate::robots::motors::LATEST;
use crate::system::start::{MAX_DRAWS, Start, least_clearance};

/// Random numbers of ChaCha8 as the crate `rand` draws them: `chacha8` and `unit`.
pub const RANDOM: &str = include_str!("random.cuh");

/// CUDA text in 64 bits for the scenes and robots of a batch: functions of the solver, `start` (draws a reset) and
/// `controlled` (torques of an action).
///
/// # Errors
/// The scene that starts keep clear of has a shape without a kernel, or more colliders than `reach`.
pub fn episode(system: &System, reach: Reach) -> Result<String, String> {
    let colliders = reach.colliders;
    let reach = Reach { driven: false, ..reach };
    let config = ArticulatedConfig::implicit(1, Friction::Coulomb);
    let clear = least_clearance(system, Start::Reset);
    let apart = match (&clear, &system.spec.data_scene) {
        (Some(_), Some(name)) => Some(system.scene(name).map_err(|e| e.to_string())?),
        _ => None,
    };
    if let Some(scene) = apart.as_ref().filter(|scene| scene.colliders.len() > colliders) {
        return Err(format!(
            "starts stand clear of scene `{}`, which has more colliders than the {colliders} of this one",
            scene.name
        ));
    }
    let record = apart.map(|scene| alone(&scene, system, Reach { own: Own::default(), ..reach })).transpose()?;
    let control = system.spec.control.as_ref();
    let mut text = functions(system, &config, Real::F64, reach, false);
    text.define([("MAX_DRAWS", MAX_DRAWS)]);
    let flags = [
        ("RELATIVE", control.is_some_and(|c| c.relative)),
        ("STABLE_PD", !reach.servo && control.is_some_and(|c| c.stable_pd)),
    ];
    let more = [
        ("CLAMPED", !reach.servo && control.is_some_and(|c| c.clamp)),
        ("CONTROLLED", control.is_some()),
        ("CLEARS", record.is_some()),
    ];
    text.define(flags.into_iter().chain(more).map(|(name, on)| (name, i32::from(on))));
    let [blurred, lagged] = reach.own.sensed();
    text.define([("BLURRED", blurred), ("LAGGED", lagged)].map(|(name, on)| (name, i32::from(on))));
    let pushes = if reach.own == Own::default() { None } else { every(system) };
    text.define(
        [("PUSH_EVERY", pushes.unwrap_or(0)), ("PUSHES", PUSHES), ("NOISES", NOISES), ("NOISE_BLOCKS", blocks(system))]
            .map(|(name, n)| (name, format!("{n}"))),
    );
    text.define([("LATEST", LATEST), ("PI", std::f64::consts::PI)]);
    text.define([("ACTION_SCALE", number(control.map_or(0.0, |c| c.scale)))]);
    starts(&mut text, system);
    text.table("double", "APART_FROM", record.unwrap_or_default());
    text.table("double", "APART", clear.unwrap_or_default());
    joints(&mut text, system);
    reach.own.write(&mut text, system, false);
    text.table("double", "LEVEL", level(system).iter().flat_map(|v| v.iter().copied()));
    text.table("double", "PUSHED", system.spec.vary.as_ref().and_then(|vary| vary.push).iter().flat_map(ends));
    Ok(text.0 + RANDOM + include_str!("episode.cuh") + include_str!("disturb.cuh"))
}

fn ends(range: &Range) -> [f64; 2] {
    [range.low, range.high]
}

/// Tables of a root's starts.
fn starts(text: &mut Text, system: &System) {
    let mut numbers = |name: &str, values: Vec<f64>| text.table("double", name, values);
    let root = system.spec.root.as_ref();
    let law = root.map(|root| root.reset.as_ref().unwrap_or(&root.sample));
    numbers("POSE", root.map_or(vec![0.0; 4], |root| quaternion(&root.quaternion).coords.as_slice().to_vec()));
    numbers("PLACES", law.map_or(Vec::new(), |l| l.position.iter().flat_map(ends).collect()));
    numbers("ANG_VEL", law.map_or(Vec::new(), |l| l.ang_vel.iter().flat_map(ends).collect()));
    numbers("VELOCITY", law.map_or(Vec::new(), |l| l.velocity.iter().flat_map(ends).collect()));
    numbers("TILTS", law.map_or(Vec::new(), |l| ends(&l.tilt).to_vec()));
}

/// Tables of the joints' starts and actions.
fn joints(text: &mut Text, system: &System) {
    let mut numbers = |name: &str, values: Vec<f64>| text.table("double", name, values);
    let specs = &system.spec.joints;
    numbers("STARTS_Q", specs.iter().flat_map(|s| ends(&s.reset.q)).collect());
    numbers("STARTS_QD", specs.iter().flat_map(|s| ends(&s.reset.qd)).collect());
    numbers("GAIN", system.joint_specs().map(|j| j.gain.unwrap_or(j.torque)).collect());
    numbers("DEFAULT_Q", system.joint_specs().map(|j| j.default_q).collect());
    let other =
        |i: usize| specs[i].reset.minus.as_ref().and_then(|name| specs[..i].iter().position(|s| &s.name == name));
    text.table("int", "MINUS", (0..specs.len()).map(|i| other(i).map_or(-1.0, |k| k as f64)));
}
