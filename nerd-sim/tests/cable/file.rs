//! The keys of a cable's file: refusals, holding, damping of stiff springs, starts above the ground and joint gains.

use nerd_sim::dataset::begin;

use super::{accurate, common::*, nodes};

/// A cable of the usual keys, with lines `before` the table `[cable]` and keys `within`, which replace usual ones.
fn lead(before: &str, within: &str) -> Result<Arc<System>, String> {
    let keys = [("length", "1.0"), ("diameter", "0.008"), ("mass", "0.08"), ("bending", "1e-3"), ("links", "8")];
    let own: String = keys
        .iter()
        .filter(|(key, _)| !within.contains(&format!("{key} =")))
        .map(|(k, v)| format!("{k} = {v}\n"))
        .collect();
    System::from_toml("lead", &format!("{before}\n[cable]\n{own}{within}")).map(Arc::new).map_err(|e| e.to_string())
}

fn refused(before: &str, within: &str, words: &[&str]) {
    let error = line(lead(before, within));
    let wanting = words.iter().find(|word| !error.contains(**word));
    assert!(wanting.is_none() && error.len() < 600, "{before} {within}: {wanting:?} is not in `{error}`");
}

#[test]
fn what_is_no_cable_is_refused_in_a_line() {
    for (keys, word) in [
        ("length = 0.0", "length"),
        ("length = nan", "length"),
        ("diameter = 2.0", "diameter"),
        ("mass = -1.0", "mass"),
        ("bending = -1e-3", "bending"),
        ("links = 0", "links"),
        ("links = 100000", "links"),
        ("direction = [0.0, 0.0, 0.0]", "direction"),
        ("support = \"glued\"", "support"),
        ("stiffness = 1.0", "stiffness"),
    ] {
        refused("", keys, &[word, "lead"]);
    }
    refused("floating = 3", "", &["floating", "lead"]);
    assert!(line(System::from_toml("lead", "[wire]\nlength = 1.0")).contains("[cable]"));
}

#[test]
fn a_cable_is_held_as_it_is_said() {
    for (held, joints, mass) in [("gripper", 6 + 3 * 8, 0.1 * 9.0 / 8.0), ("fixed", 3 * 8, 0.1), ("free", 3 * 7, 0.1)] {
        let keys =
            format!("length = 0.8\ndiameter = 0.01\nmass = 0.1\ntwisting = 8e-4\ndamping = 1e-5\nsupport = \"{held}\"");
        let system = lead("", &keys).expect("a cable");
        let robot = &system.robot;
        assert_eq!((robot.joint_count(), robot.floating()), (joints, held == "free"), "{held}");
        assert!((robot.mass() - mass).abs() < 1e-12, "{held}: {} kg", robot.mass());
        let tip = *nodes(&system, &system.default_state()).last().expect("an end");
        assert!((tip - Vector3::new(0.8, 0.0, 0.8)).norm() < 1e-12, "{held}: {tip}");
        run(&mut accurate(&system, 8), &mut at(&system, "plane", &system.default_state()), 0.0, 120);
    }
}

/// Largest |number| in the states of three random trajectories, or the error.
fn data(system: &Arc<System>) -> Result<f64, String> {
    let config = GenerateConfig { transitions: 900, frames: 300, seed: 3, ..GenerateConfig::default() };
    let recording = record(system, &mut *system.spec.truth.solver(system), &config, 0, 3).map_err(|e| e.to_string())?;
    Ok(recording.states.iter().fold(0.0, |most: f64, x| most.max(x.abs())))
}

/// Cables of any stiffness relative to the substep can be stepped. Springs that are undamped or too weakly damped in
/// the file get the damping that the substep needs.
#[test]
fn a_cable_of_any_stiffness_moves() {
    let whip = "at = [0.0, 0.0, 0.5]\nlinks = 40";
    let said = [
        whip,
        "diameter = 0.02\nmass = 0.3\nbending = 0.05\nlinks = 20",
        "length = 0.5\ndiameter = 0.006\nmass = 0.03\nlinks = 10",
    ];
    let stiff = [0.1, 1.0, 10.0]
        .into_iter()
        .flat_map(|bending| ["", "damping = 0.0", "damping = 1e-5"].map(|damping| (bending, damping)));
    let stiff = stiff
        .map(|(bending, damping)| format!("diameter = 0.01\nmass = 0.1\nlinks = 10\nbending = {bending}\n{damping}"));
    let all = said.map(String::from).into_iter().chain(stiff).chain(["twisting = 8e-4\nlinks = 40".into()]);
    for (keys, held) in all.flat_map(|keys| ["gripper", "fixed", "free"].map(|held| (keys.clone(), held))) {
        let most = lead("", &format!("{keys}\nsupport = \"{held}\"")).and_then(|system| data(&system));
        assert!(most.as_ref().is_ok_and(|most| *most < 300.0), "{held}, {keys}: {most:?} in a state");
    }
}

#[test]
fn what_is_lost_says_what_to_change() {
    let system = lead("", "support = \"fixed\"").expect("a cable");
    let mut state = system.robot.zero_state();
    state[system.robot.nq()] = 1e200;
    let solver = &mut Articulated::new(ArticulatedConfig::accurate(&system));
    let error = line(solver.step(&mut at(&system, "free", &state), &[0.0; 16]));
    assert!(["[cable] damping", "substeps", "links"].iter().all(|word| error.contains(word)), "{error}");
}

#[test]
fn a_free_cable_starts_above_the_ground_or_is_refused() {
    for height in ["0.1234567", "0.03", "2.0"] {
        let system = lead("", &format!("support = \"free\"\nposition = [0.0, 0.0, {height}]")).expect(height);
        let config = GenerateConfig { transitions: 8, frames: 1, ..GenerateConfig::default() };
        let begun = begin(&system, &config, 0, 8).expect("it begins");
        let radius = system.robot.contact_points[0].radius;
        let lowest = (0..8)
            .flat_map(|env| nodes(&system, begun.state(env)))
            .map(|node| node.z - radius)
            .fold(f64::INFINITY, f64::min);
        assert!(lowest >= 0.0, "from {height} m: {lowest} m");
        assert_eq!(system.default_state()[2], height.parse::<f64>().expect("a number"));
    }
    for held in ["free", "fixed"] {
        refused("", &format!("support = \"{held}\"\nposition = [0.0, 0.0, -0.2]"), &["[cable] position", "direction"]);
        refused(
            "",
            &format!("support = \"{held}\"\nposition = [0.0, 0.0, 0.5]\ndirection = [0.0, 0.0, -1.0]"),
            &["[cable] position", "direction"],
        );
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
