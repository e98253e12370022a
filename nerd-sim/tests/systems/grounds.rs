//! Starts of robots from MJCF on the file's ground, at any inclination and with any axis up, and on a TOML's ground.

use super::common::{at, end};
use nerd_sim::prelude::*;

/// A crate 0.2 m wide, centred at `at`, and a floor.
fn file(option: &str, floor: &str, at: &str) -> String {
    format!(
        r#"<mujoco><option {option}/><worldbody><geom type="plane" size="5 5 .1" {floor}/><body name="crate" pos="{at}"><freejoint/>
        <geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"#
    )
}

fn read(text: &str, toml: &str) -> Result<System, SystemError> {
    System::from_text("crate", text, Some(&format!("like = \"mjcf\"\n{toml}")))
}

/// Least gap (m) between the crate at a state and a scene.
fn gap(system: &System, scene: &str, state: &[f64]) -> f64 {
    let mut events = Vec::new();
    contacts(system, &system.scene(scene).expect("a scene"), state, &mut system.data(), &mut events);
    events
        .iter()
        .zip(&system.robot.contact_points)
        .map(|(event, point)| event.distance - point.radius)
        .fold(f64::MAX, f64::min)
}

/// The default pose touches the ground, and starts are above it by at most a share of the diagonal.
#[test]
fn a_robot_starts_on_the_ground_of_its_file_however_it_lies() {
    let (down, up) = (r#"gravity="0 0 -9.81""#, "0 0 .1");
    let y = r#"gravity="0 -9.81 0""#;
    for (option, floor, place) in [
        (down, r#"euler="0 5 0""#, up),
        (down, r#"euler="0 20 0""#, up),
        (down, r#"euler="30 40 10" pos="1 2 3""#, up),
        (down, r#"euler="-59 0 0""#, up),
        // Below the floor of its file, and inside it.
        (down, r#"pos="0 0 2""#, up),
        (down, "", "0 0 -3"),
        (y, r#"euler="-90 0 0""#, "0 .1 0"),
        (y, r#"euler="-110 0 0" pos="0 -4 0""#, "0 .1 0"),
        (r#"gravity="3 0 0""#, r#"euler="0 -90 0""#, ".1 0 0"),
        (r#"gravity="2 2 -3""#, r#"zaxis="-2 -2 3""#, "0 0 1"),
    ] {
        let system = read(&file(option, floor, place), "").unwrap_or_else(|e| panic!("{option}, {floor}: {e}"));
        assert_eq!(system.spec.data_scene.as_deref(), Some("ground"), "{floor}");
        let stands = gap(&system, "ground", &system.default_state());
        assert!(stands.abs() < 1e-9, "{option}, {floor}: {stands:.1e} m above the ground");
        for which in [Start::Sample, Start::Reset] {
            for k in 0..20 {
                let over = gap(&system, "ground", &start(&system, which, &mut stream(3, k)));
                assert!((0.0..0.4).contains(&over), "{option}, {floor}: start {k} is {over} m above the ground");
            }
        }
    }
}

/// Starts are above static objects of the file, and the default pose stays the file's.
#[test]
fn a_robot_inside_of_what_stands_starts_above_it() {
    let text =
        file("", "", "0 0 .1").replace("<body name", r#"<geom type="box" size=".2 .2 .2" pos=".25 0 .2"/><body name"#);
    let system = read(&text, "").expect("a crate");
    assert!(system.notes.iter().any(|note| note.contains("it starts at least 0.4")), "{:?}", system.notes);
    let inside = gap(&system, "ground", &system.default_state());
    assert!(
        (inside + 0.05).abs() < 2e-5 && (system.default_state()[2] - 0.1).abs() < 2e-5,
        "{inside} m from what stands"
    );
    for which in [Start::Sample, Start::Reset] {
        for k in 0..20 {
            let start = start(&system, which, &mut stream(3, k));
            let over = gap(&system, "ground", &start);
            assert!((0.0..0.4).contains(&over) && start[2] < 0.9, "{which:?} {k} is {over} m off, {} m high", start[2]);
        }
    }
}

/// With y up the ground carries the crate: after a second its penetration is below a hundredth of its width.
#[test]
fn a_robot_stands_where_y_is_up() {
    let system = Arc::new(read(&file(r#"gravity="0 -9.81 0""#, r#"euler="-90 0 0""#, "0 .1 0"), "").expect("a crate"));
    let last = end(
        &mut Articulated::new(ArticulatedConfig::accurate(&system)),
        at(&system, "ground", &system.default_state()),
        0.0,
        60,
    );
    let give = 0.1 - last[1];
    assert!(
        (0.0..1e-3).contains(&give) && last[0].abs() < 1e-4 && last[2].abs() < 1e-4,
        "its middle is at {:?}",
        &last[..3]
    );
}

/// Scenes are merged by name: a TOML's scenes are added to the file's, may replace it or become the data scene.
#[test]
fn scenes_of_a_toml_are_beside_that_of_the_file() {
    let text = file("", r#"pos="0 0 2""#, "0 0 0");
    let yard =
        |name: &str| format!("[[scene]]\nname = \"{name}\"\nplane = {{ height = 5.0, angles = [0.0, 0.6, 0.0] }}\n");
    for (toml, names, data, height) in [
        (yard("yard"), vec!["free", "ground", "yard"], "ground", 2.1),
        (yard("ground"), vec!["free", "ground"], "ground", 5.1),
        (format!("data_scene = \"yard\"\n{}", yard("yard")), vec!["free", "ground", "yard"], "yard", 5.1),
        ("data_scene = \"slope\"\n".into(), vec!["free", "ground"], "slope", 0.1),
    ] {
        let system = read(&text, &toml).unwrap_or_else(|e| panic!("{toml}: {e}"));
        assert_eq!((system.scene_names(), system.spec.data_scene.as_deref()), (names, Some(data)), "{toml}");
        let state = system.default_state();
        let stands = gap(&system, data, &state);
        assert!(
            stands.abs() < 1e-9 && (state[2] - height).abs() < 0.1,
            "{toml}: at {} m, {stands:.1e} m above the ground",
            state[2]
        );
    }
}

/// Errors for a robot without a TOML name no key of a TOML. Errors of derived settings name only keys that can be
/// written.
#[test]
fn refusals_speak_of_what_was_written() {
    let hill = "data_scene = \"hill\"\n[[scene]]\nname = \"hill\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\nbox = [{ size = [9, 9, 9], position = [0, 0, 0] }]\n";
    let error = read(&file("", "", "0 0 0"), hill).expect_err("no start is clear of the box").to_string();
    assert!(
        error.contains("scene `hill`") && error.contains("[root] in a .toml") && !error.contains("[root."),
        "{error}"
    );
    let text = file("", "", "0 0 0").replace(
        "</body>",
        r#"<body><joint name="hip" stiffness="1e12"/><geom size=".1" pos="0 0 .2"/></body></body>"#,
    );
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("r.xml");
    std::fs::write(&path, text).expect("written");
    let error = System::named(&path.to_string_lossy()).expect_err("no joint is as stiff").to_string();
    assert!(error.contains("joint `hip`: stiffness") && !error.contains('['), "{error}");
}
