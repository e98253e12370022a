//! What a cable's file may say: it moves, or it is refused by the key that its writer knows.

use std::sync::Arc;

use nerd_sim::dataset::{GenerateConfig, begin, record};
use nerd_sim::nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_sim::prelude::*;

/// A line of `keys` before `[cable]`, and one in it.
fn lead(before: &str, within: &str) -> Result<Arc<System>, String> {
    let keys = [("length", "1.0"), ("diameter", "0.008"), ("mass", "0.08"), ("bending", "1e-3"), ("links", "8")];
    let own: String = keys.iter().filter(|(key, _)| !within.contains(&format!("{key} ="))).map(|(k, v)| format!("{k} = {v}\n")).collect();
    System::from_toml("lead", &format!("{before}\n[cable]\n{own}{within}")).map(Arc::new).map_err(|e| e.to_string())
}

fn refused(before: &str, within: &str, words: &[&str]) {
    let error = lead(before, within).expect_err(&format!("{before} {within}"));
    let wanting = words.iter().find(|word| !error.contains(**word));
    assert!(wanting.is_none() && !error.contains('\n') && error.len() < 600, "{before} {within}: {wanting:?} is not in `{error}`");
}

/// Random data of some trajectories; the largest number in a state, or why there is none.
fn data(system: &Arc<System>) -> Result<f64, String> {
    let config = GenerateConfig { transitions: 900, frames: 300, seed: 3, ..GenerateConfig::default() };
    let recording = record(system, &mut *system.spec.truth.solver(system), &config, 0, 3).map_err(|e| e.to_string())?;
    Ok(recording.states.iter().fold(0.0, |most: f64, x| most.max(x.abs())))
}

#[test]
fn a_cable_of_which_no_damping_is_said_moves() {
    for held in ["gripper", "fixed", "free"] {
        for keys in [
            "length = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\nlinks = 40\nat = [0.0, 0.0, 0.5]",
            "length = 1.0\ndiameter = 0.02\nmass = 0.3\nbending = 0.05\nlinks = 20",
            "length = 1.0\ndiameter = 0.01\nmass = 0.1\nbending = 10.0\nlinks = 10",
            "length = 0.5\ndiameter = 0.006\nmass = 0.03\nbending = 1e-3\nlinks = 10",
            "length = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\ntwisting = 8e-4\nlinks = 40",
        ] {
            let system = Arc::new(System::from_toml("cable", &format!("[cable]\n{keys}\nheld = \"{held}\"")).expect("a cable"));
            let most = data(&system).unwrap_or_else(|error| panic!("{held}, {keys}: {error}"));
            assert!(most < 300.0, "{held}, {keys}: {most} in a state");
        }
    }
}

/// Springs that are stiff for a substep, and nothing said to calm them: they are damped by as much as the substep asks for.
#[test]
fn a_stiff_cable_with_little_damping_moves() {
    for held in ["gripper", "fixed", "free"] {
        for (bending, damping) in [(0.1, 0.0), (0.1, 1e-5), (1.0, 0.0), (1.0, 1e-5), (10.0, 0.0), (10.0, 1e-5)] {
            let keys = format!("diameter = 0.01\nmass = 0.1\nlinks = 10\nbending = {bending}\ndamping = {damping}\nheld = \"{held}\"");
            let most = lead("", &keys).and_then(|system| data(&system)).unwrap_or_else(|error| panic!("{keys}: {error}"));
            assert!(most < 300.0, "{keys}: {most} in a state");
        }
    }
}

#[test]
fn what_is_lost_says_what_to_change() {
    let system = lead("", "held = \"fixed\"").expect("a cable");
    let mut batch = Batch::new(&system, &system.scene("free").expect("a scene"), 1);
    let mut state = system.robot.zero_state();
    state[system.robot.nq()] = 1e200;
    batch.reset(0, &state);
    let error =
        Articulated::new(ArticulatedConfig::accurate(&system)).step(&mut batch, &[0.0; 16]).expect_err("beyond numbers").to_string();
    assert!(["[cable] damping", "substeps", "links"].iter().all(|word| error.contains(word)), "{error}");
}

/// How far the lowest contact point of each start is from the ground's surface (m).
fn clear(system: &Arc<System>) -> f64 {
    let config = GenerateConfig { transitions: 8, frames: 1, ..GenerateConfig::default() };
    let batch = begin(system, &config, 0, 8).expect("it begins");
    let mut data = Data::new(&system.robot);
    let lowest = (0..8).flat_map(|env| {
        kinematics(&system.robot, &batch.state(env)[..system.robot.nq()], &mut data);
        system.robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local).z - p.radius).collect::<Vec<_>>()
    });
    lowest.fold(f64::INFINITY, f64::min)
}

#[test]
fn a_free_cable_starts_above_the_ground_or_is_refused() {
    for height in ["0.1234567", "0.03", "2.0"] {
        let system = lead("", &format!("held = \"free\"\nat = [0.0, 0.0, {height}]")).expect(height);
        assert!(clear(&system) >= 0.0, "from {height} m: {} m", clear(&system));
        assert_eq!(system.default_state()[2], height.parse::<f64>().expect("a number"));
    }
    for held in ["free", "fixed"] {
        refused("", &format!("held = \"{held}\"\nat = [0.0, 0.0, -0.2]"), &["[cable] at", "along"]);
        refused("", &format!("held = \"{held}\"\nat = [0.0, 0.0, 0.5]\nalong = [0.0, 0.0, -1.0]"), &["[cable] at", "along"]);
    }
}

#[test]
fn a_gain_follows_the_torque_that_is_said_unless_it_is_said_too() {
    let gain = |more: &str| {
        let system = lead(&format!("[[joint]]\nname = \"x\"\n{more}"), "").expect("a cable");
        let joint = system.joint_specs().find(|joint| joint.name == "x").expect("x").clone();
        (joint.torque, joint.gain.unwrap_or(joint.torque))
    };
    assert_eq!(gain("torque = 2.5"), (2.5, 2.5));
    assert_eq!(gain("torque = 2.5\ngain = 1.0"), (2.5, 1.0));
    assert!(gain("").0 > 100.0, "what is not said stays");
}
