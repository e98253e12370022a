//! Contact properties of an MJCF: which geoms meet, with what friction and margin, and how deep they rest. Expected
//! values are theory, or MuJoCo 4.0's.

use super::common::*;

const G: f64 = 9.81;
/// Sliding distance `v^2 / (2 mu g)` (m) from 1 m/s at a friction coefficient of 0.2.
const SLOW: f64 = 1.0 / (2.0 * 0.2 * G);

/// A crate of 4 kg on a floor. `floor` and `side` are attributes of the two geoms, `rest` further elements.
fn on_floor(floor: &str, side: &str, rest: &str) -> Arc<System> {
    let text = format!(
        r#"<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" {floor}/><body name="crate" pos="0 0 .1"><freejoint/>
           <geom name="side" type="box" size=".1 .1 .1" density="500" {side}/></body></worldbody>{rest}</mujoco>"#
    );
    Arc::new(System::from_text("crate", &text, None).unwrap_or_else(|e| panic!("{text}: {e}")))
}

/// x and z of the crate, `seconds` after it starts in its rest pose with 1 m/s along x.
fn moved(system: &Arc<System>, seconds: f64) -> [f64; 2] {
    let mut start = system.zero_start();
    start[system.robot.nq() + 3] = 1.0;
    let end = end(&mut implicit(8), at(system, "ground", &start), 0.0, (60.0 * seconds) as usize);
    [end[0], end[2]]
}

trait ZeroStart {
    fn zero_start(&self) -> Vec<f64>;
}

impl ZeroStart for System {
    fn zero_start(&self) -> Vec<f64> {
        let mut start = self.robot.zero_state();
        start[2] = 0.1;
        start
    }
}

fn slides(floor: &str, side: &str, rest: &str, expected: f64) {
    let [x, z] = moved(&on_floor(floor, side, rest), 1.0);
    assert!(
        (x - expected).abs() < 0.01 && (z - 0.1).abs() < 2e-3,
        "{floor} {side} {rest}: slides {x} m, not {expected}, at {z} m"
    );
}

fn falls(floor: &str, side: &str, rest: &str) {
    let [_, z] = moved(&on_floor(floor, side, rest), 0.5);
    let expected = 0.1 - 0.125 * G;
    assert!((z - expected).abs() < 0.02, "{floor} {side} {rest}: at {z} m, not {expected}");
}

#[test]
fn friction_is_that_of_more_priority_or_the_larger_of_both() {
    let [rough, smooth] = [r#"friction="1""#, r#"friction=".2""#];
    slides(rough, r#"friction=".2" priority="1""#, "", SLOW);
    slides(r#"friction=".2" priority="1""#, rough, "", SLOW);
    slides(smooth, rough, "", 1.0 / (2.0 * G));
    slides(smooth, smooth, "", SLOW);
}

#[test]
fn a_contact_of_dimension_1_has_no_friction_and_the_larger_dimension_counts() {
    slides(r#"condim="1""#, r#"condim="1""#, "", 1.0);
    slides(r#"condim="1""#, r#"condim="3" friction=".2""#, "", 1.0 / (2.0 * G));
}

#[test]
fn a_pair_says_its_own_friction_and_brings_together_what_bits_keep_apart() {
    let pair = |more: &str| format!(r#"<contact><pair geom1="floor" geom2="side" {more}/></contact>"#);
    let bare = r#"contype="0" conaffinity="0""#;
    slides("", "", &pair(r#"friction=".2 .2""#), SLOW);
    slides(bare, bare, &pair(r#"friction=".2 .2""#), SLOW);
    slides("", "", &pair(r#"condim="1""#), 1.0);
    let class = r#"<default><default class="ice"><pair friction=".2 .2"/></default></default>"#;
    slides("", "", &(class.to_string() + &pair(r#"class="ice""#)), SLOW);
}

#[test]
fn an_override_is_of_all_contacts() {
    let all = r#"<option o_friction=".2 .2"><flag override="enable"/></option>"#;
    slides("", "", all, SLOW);
    slides("", "", r#"<option o_friction=".2 .2"/>"#, 1.0 / (2.0 * G));
}

#[test]
fn bits_excluded_bodies_and_flags_keep_geoms_apart() {
    falls(r#"contype="2" conaffinity="4""#, r#"contype="1" conaffinity="1""#, "");
    falls(r#"contype="0" conaffinity="0""#, "", "");
    falls("", "", r#"<contact><exclude body1="crate" body2="world"/></contact>"#);
    falls("", "", r#"<option><flag contact="disable"/></option>"#);
    slides(r#"contype="4" conaffinity="0" friction=".2""#, r#"contype="0" conaffinity="4" friction=".2""#, "", SLOW);
    slides(
        r#"friction=".2""#,
        r#"friction=".2""#,
        r#"<option><flag contact="disable"/></option><option><flag contact="enable"/></option>"#,
        SLOW,
    );
}

/// Only the large box touches the ground, so its friction counts; the friction of plates inside the box does not.
#[test]
fn each_contact_point_has_the_friction_of_its_own_geom() {
    let plate = r#"friction=".2""#;
    let text = |upper: &str| {
        format!(
            r#"<mujoco><worldbody><geom type="plane" size="5 5 .1" {plate}/><body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" density="500" {plate}/>
               {upper}</body></worldbody></mujoco>"#
        )
    };
    let upper: String =
        (0..5).map(|k| format!(r#"<geom type="box" size=".05 .05 .01" pos="0 0 .0{k}" friction="1"/>"#)).collect();
    let system = Arc::new(System::from_text("plates", &text(&upper), None).expect("a robot"));
    let [x, _] = moved(&system, 1.0);
    assert!((x - SLOW).abs() < 0.01, "slides {x} m, not {SLOW}");
}

/// Margins add, and bodies rest at the sum: MuJoCo's crate at 0.1299 m.
#[test]
fn margins_add_and_lift() {
    for (floor, side) in [("", r#"margin=".03""#), (r#"margin=".01""#, r#"margin=".02""#)] {
        let system = on_floor(floor, side, "");
        // The crate starts 30 mm inside the margin.
        let z = end(&mut implicit(4), at(&system, "ground", &system.zero_start()), 0.0, 120)[2];
        assert!((z - 0.1299).abs() < 5e-4, "{floor} {side}: rests at {z} m, not 0.1299");
    }
}

/// Contacts damp approach and separation: a crate that starts 50 or 90 mm inside the ground is pushed out, not thrown.
/// MuJoCo's crate rises to 0.109 and 0.178 m. With damping only during approach ours flew 6 and 19 m high.
#[test]
fn what_starts_inside_of_the_ground_is_not_thrown() {
    let system = on_floor("", "", "");
    for (deep, most, substeps) in
        [(0.05, 0.14), (0.09, 0.25)].into_iter().flat_map(|(deep, most)| [1, 4, 8].map(|n| (deep, most, n)))
    {
        let mut start = system.zero_start();
        start[2] -= deep;
        let mut batch = at(&system, "ground", &start);
        let mut highest = 0.0f64;
        for _ in 0..90 {
            implicit(substeps).step(&mut batch, &[]).expect("steps");
            highest = highest.max(batch.states[2]);
        }
        assert!(
            highest < most && (batch.states[2] - 0.1).abs() < 1e-3,
            "{deep} m deep, x{substeps}: rises to {highest} m, ends at {} m",
            batch.states[2]
        );
    }
}

/// A ball of condim 6 stops after `0.7 v^2 r / (mu_r g)`; a ball of condim 3 rolls on.
#[test]
fn a_ball_stops_by_the_rolling_friction_of_its_file() {
    let ball = |condim: usize| {
        let own = format!(r#"condim="{condim}" friction="1 .005 .02""#);
        let text = format!(
            r#"<mujoco><worldbody><geom type="plane" size="5 5 .1" {own}/><body pos="0 0 .1"><freejoint/><geom type="sphere" size=".1" {own}/></body>
               </worldbody></mujoco>"#
        );
        let system = Arc::new(System::from_text("ball", &text, None).expect("a robot"));
        let mut start = system.zero_start();
        let nq = system.robot.nq();
        (start[nq + 1], start[nq + 3]) = (10.0, 1.0 - 10.0 * 0.1);
        end(&mut implicit(4), at(&system, "ground", &start), 0.0, 180)[0]
    };
    let (rolls, stops, expected) = (ball(3), ball(6), 0.7 * 0.1 / (0.02 * G));
    assert!(
        (stops / expected - 1.0).abs() < 0.02 && (rolls - 3.0).abs() < 0.02,
        "stops after {stops} m, not {expected}; else rolls {rolls} m"
    );
}

/// A crate of 4 kg on four corners rests as deep as MuJoCo's. That is 0.1078 mm with default `solref`, and 0.8603 mm
/// with a time constant of 82 ms. Our crate rests 0.01 mm higher, the radius of a corner.
#[test]
fn a_crate_rests_as_deep_as_the_files_softness_says() {
    let deep = |side: &str| {
        let system = on_floor("", side, "");
        1e3 * (0.1 - end(&mut implicit(4), at(&system, "ground", &system.zero_start()), 0.0, 240)[2])
    };
    let [stiff, soft] = [deep(""), deep(r#"solref=".082 1" priority="1""#)];
    assert!(
        (stiff + 0.01 - 0.10776).abs() < 1e-4 && (soft + 0.01 - 0.86026).abs() < 1e-3,
        "{stiff} and {soft} mm deep"
    );
}

/// Static geoms of the file's world are in its scene, and a TOML's scene beside it does not replace it.
#[test]
fn the_world_of_a_file_is_its_scene() {
    let text = r#"<mujoco><worldbody><geom type="plane" size="5 5 .1"/><body pos="1 0 .5"><geom type="box" size=".2 .2 .5"/></body><body pos="1 0 1.2">
        <freejoint/><geom type="box" size=".1 .1 .1" density="500"/></body></worldbody></mujoco>"#;
    let own = "like = \"urdf\"\n[[scene]]\nname = \"yard\"\nplane = { height = -1.0, angles = [0, 0, 0] }\n";
    for spec in [None, Some(own)] {
        let system = Arc::new(System::from_text("crate", text, spec).expect("a robot"));
        let mut start = system.robot.zero_state();
        (start[0], start[2]) = (1.0, 1.2);
        let z = end(&mut implicit(4), at(&system, "ground", &start), 0.0, 120)[2];
        assert!((z - 1.1).abs() < 2e-3, "{spec:?}: it rests on the box at {z} m, not 1.1");
    }
}
