//! Impossible settings are refused by key, in one line. The campaign of `xtask` checks that all others move finitely.

use super::common::*;

/// A floating body with a hinge and a rail.
fn all() -> String {
    let limits =
        |lower: &str, upper: &str| format!(r#"<limit lower="{lower}" upper="{upper}" effort="10" velocity="5"/>"#);
    urdf(&[
        link("body", 2.0, [0.0; 3], [0.1; 3], &collision([0.0; 3], r#"<sphere radius="0.1"/>"#)),
        link("arm", 1.0, [0.1, 0.0, 0.0], [0.01; 3], ""),
        link("cart", 1.0, [0.0; 3], [0.01; 3], ""),
        joint("hinge", "revolute", ["body", "arm"], &(r#"<axis xyz="0 1 0"/>"#.to_string() + &limits("-1", "1"))),
        joint(
            "rail",
            "prismatic",
            ["arm", "cart"],
            &(r#"<origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>"#.to_string() + &limits("0", "0.1")),
        ),
    ])
}

const TOML: &str = r#"urdf = "all.urdf"
floating = true
frame_time = "1/60"
gravity = [0.1, 0.2, -9.81]
substeps = 16
data_scene = "ground"
material = { stiffness = 1e4, damping = 1e2, friction_damping = 1e2, friction = 0.5 }
random_plane = { reach = 3.5, clearance = 0.1 }
[control]
scale = 0.5
data = { kp = "U(1, 2)", kd = "U(0.1, 0.2)" }
[root]
position = [0.0, 0.1, 1.0]
quaternion = [0.1, 0.2, 0.3, 0.9]
[root.sample]
position = ["U(-0.1, 0.1)", "U(-0.2, 0.2)", "U(1, 1.3)"]
tilt = "U(-0.3, 0.3)"
ang_vel = ["U(-0.4, 0.4)", "U(-0.5, 0.5)", "U(-0.6, 0.6)"]
velocity = ["U(-0.7, 0.7)", "U(-0.8, 0.8)", "U(-0.9, 0.9)"]
clearance = 0.001
[[joint]]
name = "hinge"
default_q = 0.15
armature = 0.01
limit = { stiffness = 1e2, damping = 1.5 }
torque = 1.25
gain = 1.75
kp = 3.0
kd = 0.25
sample = { q = "U(-0.95, 0.95)", qd = "U(-1.1, 1.1)" }
reset = { q = "U(-0.11, 0.11)", qd = "U(-0.12, 0.12)" }
[[joint]]
name = "rail"
torque = 0.5
sample = { q = "U(0.01, 0.02)", qd = "U(-0.13, 0.13)" }
reset = { q = "U(0.03, 0.04)", qd = "U(-0.14, 0.14)", minus = "hinge" }
[[contact]]
link = "body"
point = [0.01, 0.02, -0.03]
radius = 0.1
thickness = 0.12
[[contact]]
link = "arm"
point = [0.04, 0.05, 0.06]
axis = [0.1, 0.2, 1.0]
rim = 0.05
[[scene]]
name = "ground"
plane = { height = 0.01, angles = [0.0, 0.05, 0.06] }
material = { stiffness = 2e4, damping = 3e2, friction_damping = 4e2, friction = 0.7 }
"#;

fn system(toml: &str) -> Result<System, String> {
    System::from_text("all", &all(), Some(toml)).map_err(|e| e.to_string())
}

/// Places of the numbers in the text, with the name of their key.
fn numbers() -> Vec<(std::ops::Range<usize>, String)> {
    let (mut found, mut at) = (Vec::new(), 0);
    let ends = |c: char| !(c.is_ascii_alphanumeric() || "+-.".contains(c));
    while at < TOML.len() {
        let word = &TOML[at..][..TOML[at..].find(ends).unwrap_or(TOML.len() - at)];
        if word.parse::<f64>().is_ok() {
            // Entries of a vector or a table belong to the last word before an equals sign.
            let key = TOML[..at].rsplit_once(" =").map(|(before, _)| before);
            let key =
                key.and_then(|b| b.rsplit(|c: char| !(c.is_ascii_alphabetic() || c == '_')).next()).unwrap_or_default();
            found.push((at..at + word.len(), key.to_string()));
        }
        at += word.len().max(1);
    }
    found
}

fn with(range: &std::ops::Range<usize>, number: &str) -> String {
    [&TOML[..range.start], number, &TOML[range.end..]].concat()
}

#[test]
fn every_number_is_looked_at() {
    system(TOML).expect("valid as it is");
    let numbers = numbers();
    assert!(numbers.len() > 80, "{} numbers", numbers.len());
    for (range, key) in &numbers {
        for number in ["nan", "inf", "-inf", "-1e300", "1e300"] {
            let error = line(system(&with(range, number)));
            assert!(error.contains(key.as_str()), "{key} = {number}: `{error}`");
        }
    }
}

#[test]
fn words_are_looked_at() {
    let table = [
        ("substeps = 16", "substeps = 0", "substeps"),
        ("substeps = 16", "substeps = 1000000000", "substeps"),
        ("\"1/60\"", "\"1e-300\"", "frame_time"),
        ("\"1/60\"", "\"0/1\"", "frame_time"),
        ("\"1/60\"", "\"1/1/1\"", "frame_time"),
        (
            "armature = 0.01",
            "armature = -1",
            "name = \"hinge\": armature is -1 kg m^2; a number from 0 to 1000000 is needed",
        ),
        ("kp = \"U(1, 2)\"", "kp = \"U(-1, 2)\"", "data.kp"),
        ("kp = \"U(1, 2)\"", "kp = \"U(2, 1)\"", "kp"),
        ("minus = \"hinge\"", "minus = \"hing\"", "minus"),
        ("minus = \"hinge\"", "minus = \"rail\"", "minus"),
        ("gravity = [0.1, 0.2, -9.81]", "gravity = [0.1, 0.2, -9.81, 0.0]", "gravity"),
        ("gravity = [0.1, 0.2, -9.81]", "gravity = [0.0, 0.0, 1e-200]", "gravity"),
        ("quaternion = [0.1, 0.2, 0.3, 0.9]", "quaternion = [0.0, 0.0, 0.0, 0.0]", "quaternion"),
        ("quaternion = [0.1, 0.2, 0.3, 0.9]", "quaternion = [0.1, 0.2, 0.3]", "quaternion"),
        ("name = \"rail\"", "name = \"hinge\"", "twice"),
        ("name = \"rail\"", "name = \"rial\"", "rial"),
        ("name = \"ground\"", "name = \"plane\"", "[[scene]] name = \"plane\""),
        ("name = \"ground\"", "name = \"\"", "[[scene]]"),
        ("link = \"body\"", "link = \"bdy\"", "bdy"),
        ("data_scene = \"ground\"\n", "", "clearance"),
        ("data_scene = \"ground\"", "data_scene = \"grund\"", "grund"),
        ("default_q = 0.15", "default_q = 0.15\ncolumn = \"tau_x\"", "tau_x"),
        ("default_q = 0.15", "default_q = 0.15\ncolumn = \"step\"", "step"),
        ("default_q = 0.15", "default_q = 0.15\ncolumn = \"px\"", "px"),
        ("default_q = 0.15", "default_q = 0.15\ncolumn = \" x\"", "blanks"),
        ("default_q = 0.15", "defualt_q = 0.15", "defualt_q"),
        ("substeps = 16", "substeps = 16\ntorque_columns = [\"a\", \"a\"]", "torque_columns"),
        ("substeps = 16", "substeps = 16\ntorque_columns = [\"a\"]", "torque_columns: 1 entries, the robot needs 2"),
        ("substeps = 16", "substeps = 16\nmass_matrix_of = { arm = \"rm\" }", "rm"),
    ];
    for (from, to, words) in table {
        let error = line(system(&changed(TOML, from, to)));
        assert!(error.contains(words), "{to}: `{error}` does not say {words}");
    }
    assert!(line(system(&format!("{TOML}{GROUND}"))).contains("ground"), "two scenes of a name");
}

#[test]
fn the_urdf_that_a_file_names_is_the_one_that_is_read() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (urdf, toml) = (folder.path().join("all.urdf"), folder.path().join("all.toml"));
    std::fs::write(&urdf, all()).expect("written");
    let read = |text: &str| {
        std::fs::write(&toml, text).expect("written");
        System::named(urdf.to_str().expect("utf-8")).map_err(|e| e.to_string())
    };
    read(TOML).expect("its own name");
    read(&TOML.replacen("urdf = \"all.urdf\"\n", "", 1)).expect("no name");
    let error = line(read(&TOML.replacen("all.urdf", "other.urdf", 1)));
    assert!(error.contains("urdf = \"other.urdf\"") && error.contains("all.urdf"), "{error}");
    std::fs::write(&urdf, b"<robot name=\"\xe9\">").expect("written");
    let error = line(read(TOML));
    assert!(error.contains("all.urdf") && error.contains("UTF-8"), "{error}");
}

#[test]
fn a_solver_refuses_to_stand_still() {
    let mut batch = batch(&built_in("cartpole"), "free", 1);
    for substeps in [0, usize::MAX] {
        let config = ArticulatedConfig { substeps, ..ArticulatedConfig::paper(&batch.system, Friction::Coulomb) };
        let error = line(Articulated::new(config).step(&mut batch, &[1.0, 0.0]));
        assert!(error.contains("substeps") && error.contains("100000"), "{error}");
    }
    batch.states.pop();
    assert!(line(batch.check()).contains("4 numbers in `states`"), "one number short");
}

#[test]
fn data_that_cannot_be_made_are_refused_by_name() {
    let system = built_in("cartpole");
    let usual = GenerateConfig { transitions: 100, frames: 10, ..Default::default() };
    for (config, words) in [
        (GenerateConfig { frames: 0, ..usual.clone() }, "frames"),
        (GenerateConfig { transitions: 0, ..usual.clone() }, "transitions"),
        (GenerateConfig { shard_trajectories: 0, ..usual.clone() }, "shard_trajectories"),
        (GenerateConfig { hold: 0, ..usual.clone() }, "hold"),
        (GenerateConfig { hold: usize::MAX, ..usual.clone() }, "hold"),
        (GenerateConfig { resets: f64::NAN, ..usual.clone() }, "resets"),
        (GenerateConfig { transitions: 1_000_000_000, frames: 1_000_000, ..usual.clone() }, "GB"),
    ] {
        let error = line(record(&system, &mut implicit(1), &config, 0, 2));
        assert!(error.contains(words), "{error}");
    }
}
