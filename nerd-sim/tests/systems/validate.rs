//! What a specification says is either refused by its key, in one line, or gives finite motion.

use nerd_sim::dataset::{GenerateConfig, record};
use nerd_sim::prelude::*;
use proptest::prelude::*;

/// A floating body with a hinge, a rail and every key there is.
const URDF: &str = r#"<robot name="all"><link name="body"><inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="cart"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="body"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="5"/></joint>
<joint name="rail" type="prismatic"><parent link="arm"/><child link="cart"/><origin xyz="0.2 0 0"/><axis xyz="1 0 0"/><limit lower="0" upper="0.1" effort="10" velocity="5"/></joint></robot>"#;

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
angular = ["U(-0.4, 0.4)", "U(-0.5, 0.5)", "U(-0.6, 0.6)"]
linear = ["U(-0.7, 0.7)", "U(-0.8, 0.8)", "U(-0.9, 0.9)"]
clearance = 0.001
[[joint]]
name = "hinge"
default = 0.15
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
[[scene]]
name = "ground"
plane = { height = 0.01, angles = [0.0, 0.05, 0.06] }
material = { stiffness = 2e4, damping = 3e2, friction_damping = 4e2, friction = 0.7 }
"#;

fn system(toml: &str) -> Result<System, String> {
    System::from_text("all", URDF, Some(toml)).map_err(|e| e.to_string())
}

/// Where numbers stand in the text, with the name of their key.
fn numbers() -> Vec<(std::ops::Range<usize>, String)> {
    let (mut found, mut at) = (Vec::new(), 0);
    let ends = |c: char| !(c.is_ascii_alphanumeric() || "+-.".contains(c));
    while at < TOML.len() {
        let word = &TOML[at..][..TOML[at..].find(ends).unwrap_or(TOML.len() - at)];
        if word.parse::<f64>().is_ok() {
            // A vector's or a table's entries belong to the last word before an equals sign.
            let key = TOML[..at].rsplit_once(" =").map(|(before, _)| before);
            let key = key.and_then(|b| b.rsplit(|c: char| !(c.is_ascii_alphabetic() || c == '_')).next()).unwrap_or_default();
            found.push((at..at + word.len(), key.to_string()));
        }
        at += word.len().max(1);
    }
    found
}

fn with(range: &std::ops::Range<usize>, number: &str) -> String {
    let mut text = TOML.to_string();
    text.replace_range(range.clone(), number);
    text
}

/// Refused by key in one line, or finite for half a second; a step that fails says where.
fn refused_or_finite(toml: &str, key: &str, change: &str) {
    match system(toml) {
        // No clear start follows from several keys together.
        Err(e) => assert!(
            (e.contains(key) || e.contains("clearance")) && !e.contains('\n'),
            "{key} as {change}: `{e}` does not name the key in one line"
        ),
        Ok(system) => {
            let system = std::sync::Arc::new(system);
            let config = GenerateConfig { transitions: 60, frames: 30, ..Default::default() };
            let mut truth = Articulated::new(ArticulatedConfig::implicit(16, Friction::Coulomb));
            if let Ok(r) = record(&system, &mut truth, &config, 0, 2) {
                assert!(r.states.iter().all(|x| x.is_finite()), "{key} as {change} is accepted, its motion is not finite");
            }
        }
    }
}

#[test]
fn every_number_is_looked_at() {
    system(TOML).expect("valid as it is");
    let all = numbers();
    assert!(all.len() > 80, "{} numbers", all.len());
    for (range, key) in &all {
        for number in ["nan", "inf", "-inf", "-1e300", "1e300"] {
            let error = system(&with(range, number)).expect_err(&format!("{key} = {number}"));
            assert!(error.contains(key.as_str()) && !error.contains('\n'), "{key} = {number}: `{error}`");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_is_accepted_moves_finitely(which in 0..1000usize, mantissa in -10.0..10.0f64, power in -12..12i32) {
        let all = numbers();
        let (range, key) = &all[which % all.len()];
        let number = format!("{:e}", mantissa * 10f64.powi(power));
        refused_or_finite(&with(range, &number), key, &number);
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
        ("armature = 0.01", "armature = -1", "name = \"hinge\": armature is -1 kg m^2; a number from 0 to 1e6 is needed"),
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
        ("default = 0.15", "default = 0.15\ncolumn = \"tau_x\"", "tau_x"),
        ("default = 0.15", "default = 0.15\ncolumn = \"step\"", "step"),
        ("default = 0.15", "default = 0.15\ncolumn = \"px\"", "px"),
        ("default = 0.15", "default = 0.15\ncolumn = \" x\"", "blanks"),
        ("default = 0.15", "defualt = 0.15", "defualt"),
        ("substeps = 16", "substeps = 16\ntorque_columns = [\"a\", \"a\"]", "torque_columns"),
        ("substeps = 16", "substeps = 16\ntorque_columns = [\"a\"]", "torque_columns: 1 entries, the robot needs 2"),
        ("substeps = 16", "substeps = 16\nmass_matrix_of = { arm = \"rm\" }", "rm"),
    ];
    for (from, to, words) in table {
        let text = TOML.replacen(from, to, 1);
        assert_ne!(text, TOML, "`{from}` is not in the text");
        let error = system(&text).expect_err(to);
        assert!(error.contains(words) && !error.contains('\n'), "{to}: `{error}` does not say {words}");
    }
    let twice = format!("{TOML}[[scene]]\nname = \"ground\"\nplane = {{ height = 0.0, angles = [0.0, 0.0, 0.0] }}\n");
    assert!(system(&twice).expect_err("two scenes of a name").contains("ground"));
}

#[test]
fn the_urdf_that_a_file_names_is_the_one_that_is_read() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (urdf, toml) = (folder.path().join("all.urdf"), folder.path().join("all.toml"));
    std::fs::write(&urdf, URDF).expect("written");
    let read = |text: &str| {
        std::fs::write(&toml, text).expect("written");
        System::named(urdf.to_str().expect("utf-8")).map_err(|e| e.to_string())
    };
    read(TOML).expect("its own name");
    read(&TOML.replacen("urdf = \"all.urdf\"\n", "", 1)).expect("no name");
    let error = read(&TOML.replacen("all.urdf", "other.urdf", 1)).expect_err("another name");
    assert!(error.contains("urdf = \"other.urdf\"") && error.contains("all.urdf"), "{error}");
    std::fs::write(&urdf, b"<robot name=\"\xe9\">").expect("written");
    let error = read(TOML).expect_err("latin-1");
    assert!(error.contains("all.urdf") && error.contains("UTF-8"), "{error}");
}

#[test]
fn a_solver_refuses_to_stand_still() {
    let system = System::named("cartpole").expect("built in");
    for n in [0, usize::MAX] {
        let mut batch = Batch::new(&system, &system.scene("free").expect("empty"), 1);
        let config = ArticulatedConfig { substeps: n, ..ArticulatedConfig::paper(&system, Friction::Coulomb) };
        let error = Articulated::new(config).step(&mut batch, &[1.0, 0.0]).expect_err("no step").to_string();
        assert!(error.contains("substeps") && error.contains("1e5"), "{error}");
    }
}

#[test]
fn data_that_cannot_be_made_are_refused_by_name() {
    let system = System::named("cartpole").expect("built in");
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
        let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
        let error = record(&system, &mut truth, &config, 0, 2).expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn fields_of_a_batch_that_disagree_are_told() {
    let system = System::named("cartpole").expect("built in");
    let mut batch = Batch::new(&system, &system.scene("free").expect("empty"), 2);
    assert_eq!(batch.check(), Ok(()));
    batch.states.pop();
    assert!(batch.check().expect_err("one number short").contains("8 numbers in `states`"));
}
