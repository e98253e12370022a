//! A system is identified by content: its hashes depend on every number that matters, and on nothing else.

use super::common::*;

const URDF: &str = include_str!("../../assets/pendulum.urdf");
const TOML: &str = include_str!("../../assets/pendulum.toml");

/// Hashes of the robot, and of the whole system.
fn hashes(urdf: &str, toml: &str) -> [String; 2] {
    let system = System::from_text("pendulum", urdf, Some(toml)).expect("valid");
    [system.robot_sha256(), system.sha256()]
}

#[test]
fn how_it_is_written_changes_nothing() {
    let ours = hashes(URDF, TOML);
    for (from, to) in [
        ("substeps = 8", "# a comment\nsubsteps   =   8"),
        ("\"1/60\"", "\"0.016666666666666666\""),
        ("[0.0, -9.81, 0.0]", "[-0.0, -9.81, -0.0]"),
        ("1e4, damping", "10000.0, damping"),
        ("U(-2pi, 2pi)", "U(-6.283185307179586, 2pi)"),
        ("\"tau1\"", "\"tau_shoulder\""),
        ("urdf = \"pendulum.urdf\"\n", ""),
        // `truth` is on the cards of models, so it is not hashed.
        ("substeps = 8", "substeps = 8\ntruth = \"paper\""),
    ] {
        assert_eq!(hashes(URDF, &changed(TOML, from, to)), ours, "`{from}` as `{to}`");
    }
    assert_eq!(
        hashes(URDF, &format!("substeps = 8\n{}", changed(TOML, "substeps = 8", ""))),
        ours,
        "another order of keys"
    );
    let spaced = URDF.replace("><", ">\n <!-- here --> <").replace("<robot ", "<robot\n  ");
    assert_eq!(hashes(&spaced, TOML), ours);
    // Tables of joints in another order: they are matched by name.
    let at: Vec<usize> =
        TOML.match_indices("[[joint]]").chain(TOML.match_indices("[[contact]]")).map(|m| m.0).collect();
    let (first, second) = (&TOML[at[0]..at[1]], &TOML[at[1]..at[2]]);
    assert_eq!(hashes(URDF, &changed(TOML, &format!("{first}{second}"), &format!("{second}{first}"))), ours);
}

/// Cards of models that were trained long ago hold these hashes.
#[test]
fn hashes_stay_what_they_were() {
    let varied = format!("{TOML}\n[vary]\nmass = \"U(0.8, 1.2)\"\n");
    let expected = [
        "c2e9fd2cfb6ae0fa27acb3e70638924861cf9bd754c5df51b2ecf1e5c366a092",
        "62fd59c0700e3d9c5c49b1fc6a0c09a354311367ff90b357081e1630f067a4d9",
    ];
    for (toml, expected) in [TOML, &varied].into_iter().zip(expected) {
        assert_eq!(hashes(URDF, toml)[1], expected);
    }
}

/// Changes to the motion change both hashes; changes to data recording change the system's alone.
#[test]
fn what_matters_is_seen() {
    let ours = hashes(URDF, TOML);
    for (from, to) in [
        ("-9.81", "-9.82"),
        ("1/60", "1/61"),
        ("substeps = 8", "substeps = 6"),
        ("substeps = 8", "substeps = 8\nrefresh = \"substep\""),
        ("armature = 0.01", "armature = 0.02"),
        ("friction = 0.5", "friction = 0.6"),
        ("point = [1.5, 0.0, 0.0]", "point = [1.5, 0.0, 1e-9]"),
        ("radius = 0.10001", "radius = 0.1"),
        ("thickness = 0.1", "thickness = 0.2"),
    ] {
        let found = hashes(URDF, &changed(TOML, from, to));
        assert!(found[0] != ours[0] && found[1] != ours[1], "{from} as {to} is not seen");
    }
    let mass = URDF.split("<mass").nth(1).and_then(|m| m.split('>').next()).expect("a mass");
    for (from, to) in [(mass, " value=\"1\"/"), ("<axis", "<dynamics damping=\"0.1\" friction=\"0\"/><axis")] {
        let found = hashes(&changed(URDF, from, to), TOML);
        assert!(found[0] != ours[0] && found[1] != ours[1], "{from} as {to} is not seen");
    }
    for (from, to) in [
        ("U(-4pi, 4pi)", "U(-4pi, 3pi)"),
        ("qd = \"U(-2, 2)\"", "qd = \"U(-2, 1)\""),
        (", minus = \"joint1\"", ""),
        ("torque = 1500.0", "torque = 1400.0"),
        ("torque = 1500.0", "torque = 1500.0\nkp = 1.0"),
        ("reach = 3.5", "reach = 3.6"),
        ("height = 0.5", "height = 0.6"),
        ("name = \"ground6\"", "name = \"slope6\""),
        ("substeps = 8", "substeps = 8\ndata_scene = \"ground1\""),
    ] {
        let found = hashes(URDF, &changed(TOML, from, to));
        assert!(found[0] == ours[0] && found[1] != ours[1], "{from} as {to}: {found:?}");
    }
}

#[test]
fn limits_count_and_all_built_in_robots_differ() {
    let (toml, urdf) = System::texts("cartpole").expect("built in");
    let robot = |urdf: &str, toml: &str| hashes(urdf, toml)[0].clone();
    let ours = robot(urdf, toml);
    // Without contact the material does not matter.
    let slippery =
        "substeps = 4\nmaterial = { stiffness = 1.0, damping = 1.0, friction_damping = 1.0, friction = 0.0 }";
    assert_eq!(robot(urdf, &changed(toml, "substeps = 4", slippery)), ours);
    assert_ne!(robot(&changed(urdf, "lower=\"-4\"", "lower=\"-3.9\""), toml), ours);
    assert_ne!(robot(urdf, &changed(toml, "damping = 10.0", "damping = 11.0")), ours);
    let mut all: Vec<String> = System::built_in().into_iter().map(|name| built_in(name).robot_sha256()).collect();
    assert!(all.iter().all(|h| h.len() == 64 && h.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))));
    all.sort();
    all.dedup();
    assert_eq!(all.len(), System::built_in().len(), "two robots of one hash");
}
