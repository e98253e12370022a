//! What a URDF alone suggests: which bases are free, contact that scales with the robot, starts within its limits and clear of the ground, and
//! a TOML that says a part.

use std::path::PathBuf;
use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

fn body(name: &str, mass: f64, size: [f64; 3], at: [f64; 3]) -> String {
    let [x, y, z] = size;
    let inertia = |a: f64, b: f64| mass * (a * a + b * b) / 12.0;
    let place = format!("<origin xyz=\"{} {} {}\"/>", at[0], at[1], at[2]);
    format!(
        "<link name=\"{name}\"><inertial>{place}<mass value=\"{mass}\"/><inertia ixx=\"{}\" iyy=\"{}\" izz=\"{}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>\
         <collision>{place}<geometry><box size=\"{x} {y} {z}\"/></geometry></collision></link>",
        inertia(y, z),
        inertia(x, z),
        inertia(x, y)
    )
}

fn joint(name: &str, [parent, child]: [&str; 2], at: [f64; 3], effort: f64) -> String {
    format!(
        "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"{} {} {}\"/><axis xyz=\"0 1 0\"/>\
         <limit lower=\"-1\" upper=\"0.8\" effort=\"{effort}\" velocity=\"10\"/></joint>",
        at[0], at[1], at[2]
    )
}

/// A table on four hinged legs, all lengths times `scale`.
fn table(scale: f64) -> String {
    let s = |x: f64| x * scale;
    let mass = |m: f64| m * scale.powi(3);
    let mut text = body("trunk", mass(6.0), [s(0.6), s(0.3), s(0.1)], [0.0; 3]);
    for (k, [x, y]) in [[0.3, 0.15], [0.3, -0.15], [-0.3, 0.15], [-0.3, -0.15]].into_iter().enumerate() {
        text += &body(&format!("leg{k}"), mass(1.0), [s(0.04), s(0.04), s(0.3)], [0.0, 0.0, s(-0.15)]);
        text += &joint(&format!("hip{k}"), ["trunk", &format!("leg{k}")], [s(x), s(y), 0.0], mass(20.0) * scale);
    }
    format!("<robot name=\"table\">{text}</robot>")
}

/// A chain of links on a pedestal.
fn arm() -> String {
    let mut text = body("pedestal", 20.0, [0.2, 0.2, 0.2], [0.0, 0.0, 0.1]);
    for k in 0..3 {
        text += &body(&format!("link{k}"), 2.0, [0.06, 0.06, 0.3], [0.0, 0.0, 0.15]);
        let parent = if k == 0 { "pedestal".to_string() } else { format!("link{}", k - 1) };
        text += &joint(&format!("joint{k}"), [&parent, &format!("link{k}")], [0.0, 0.0, if k == 0 { 0.2 } else { 0.3 }], 50.0);
    }
    format!("<robot name=\"arm\">{text}</robot>")
}

/// A folder of a test's own with a URDF, and a TOML beside it.
fn file(name: &str, urdf: &str, toml: Option<&str>) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("nerd-derived-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for files");
    let path = folder.join("robot.urdf");
    std::fs::write(&path, urdf).expect("written");
    match toml {
        Some(text) => std::fs::write(path.with_extension("toml"), text).expect("written"),
        None => drop(std::fs::remove_file(path.with_extension("toml"))),
    }
    path
}

fn read(name: &str, urdf: &str, toml: Option<&str>) -> Result<Arc<System>, SystemError> {
    System::named(&file(name, urdf, toml).to_string_lossy())
}

#[test]
fn what_walks_is_free_and_what_is_an_arm_is_not() {
    let brick = format!("<robot name=\"brick\">{}</robot>", body("brick", 1.0, [0.1; 3], [0.0; 3]));
    for (name, urdf, free) in [("table", table(1.0), true), ("arm", arm(), false), ("brick", brick, true)] {
        let system = read(name, &urdf, None).expect("a robot");
        assert_eq!(system.robot.floating(), free, "{name}");
        assert!(system.notes.iter().any(|n| n.contains(if free { "free base" } else { "fixed base" })), "{:?}", system.notes);
        let other = read(name, &urdf, Some(&format!("like = \"urdf\"\nfloating = {}", !free)));
        match other {
            Ok(other) => assert_eq!(other.robot.floating(), !free, "{name}: one line says otherwise"),
            Err(e) => assert!(name == "brick" && e.to_string().contains("moves"), "{name}: {e}"),
        }
    }
}

#[test]
fn a_part_of_a_toml_goes_before_what_the_urdf_suggests() {
    let text = "like = \"urdf\"\nframe_time = \"1/100\"\n[[joint]]\nname = \"hip1\"\narmature = 0.03\n";
    let system = read("part", &table(1.0), Some(text)).expect("a part is enough");
    let plain = read("part-plain", &table(1.0), None).expect("a robot");
    assert_eq!(system.frame_time, 0.01);
    let armatures: Vec<f64> = system.robot.joints().map(|j| j.armature).collect();
    // Effort and velocity of 20 N m and 10 rad/s make the others: 10 ms from rest.
    assert_eq!(armatures, [0.02, 0.03, 0.02, 0.02]);
    assert_eq!(system.joint_specs().nth(1).map(|j| j.kp), plain.joint_specs().nth(1).map(|j| j.kp), "the rest of the joint is what it was");
    for (line, said) in [
        ("joint = 3", "[[joint]]"),
        ("[[joint]]\nname = \"hip1\"\n[[joint]]\nname = \"hip1\"", "twice"),
        ("flotaing = true", "flotaing"),
        ("[[joint]]\nname = \"knee\"", "knee"),
        ("substeps = 0", "substeps"),
        ("like = \"me\"", "like"),
    ] {
        let text = if line.starts_with("like") { line.into() } else { format!("like = \"urdf\"\n{line}") };
        let error = read("wrong", &table(1.0), Some(&text)).expect_err(line).to_string();
        assert!(error.contains(said) && !error.contains('\n'), "{line}: {error}");
    }
}

/// What is printed may stand beside the file, and is the same robot.
#[test]
fn the_printed_specification_is_the_robot() {
    for (name, urdf) in [("same-table", table(1.0)), ("same-arm", arm())] {
        let system = read(name, &urdf, None).expect("a robot");
        let again =
            read(&format!("{name}-again"), &urdf, Some(&format!("like = \"urdf\"\n{}", system.spec_text()))).expect("it was printed by us");
        assert_eq!(again.sha256(), system.sha256(), "{name}:\n{}", system.spec_text());
    }
}

/// Of tables from a toy's size to a house's: at rest each is pressed in by a thousandth of its size, and it starts clear of the ground.
#[test]
fn contact_scales_with_the_robot() {
    for scale in [0.1, 1.0, 10.0] {
        let system = read(&format!("scale-{scale}"), &table(scale), None).expect("a robot");
        let scene = system.scene("plane").expect("a plane");
        let mut batch = Batch::new(&system, &scene, 1);
        batch.reset(0, &system.default_state());
        let high = system.default_state()[2];
        batch.drives = nerd_sim::drive::specified(&system);
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        (0..120).for_each(|_| solver.step(&mut batch, &[0.0; 4]).expect("it stands"));
        let give = (high - batch.state(0)[2]) / (0.6 * scale);
        assert!((2e-4..3e-3).contains(&give), "scale {scale}: pressed in by {give} of its length");
        let at = batch.state(0);
        assert!(at[6].abs() > 0.999, "scale {scale}: it fell over: {:?}", &at[3..7]);
        for k in 0..50 {
            let which = if k % 2 == 0 { Start::Sample } else { Start::Reset };
            let state = start(&system, which, &mut stream(1, k));
            let mut events = Vec::new();
            nerd_sim::scene::contacts(
                &system.robot,
                &scene,
                &state,
                &mut nerd_sim::nerd_core::dynamics::Data::new(&system.robot),
                &mut events,
            );
            let clear = events.iter().zip(&system.robot.contact_points).all(|(e, p)| e.distance > p.radius);
            assert!(clear, "a start within the ground");
            assert!(state[7..11].iter().all(|q| (-1.0..=0.8).contains(q)), "a start beyond the limits: {:?}", &state[7..11]);
        }
    }
}

/// What a robot rests on is what it had: balls at the ends of legs, wheels all around, and a height at which they touch.
#[test]
fn what_stands_keeps_its_feet() {
    let ball = "<collision><origin xyz=\"0 0 -0.3\"/><geometry><sphere radius=\"0.04\"/></geometry></collision></link>";
    let trunk = body("trunk", 6.0, [0.6, 0.3, 0.1], [0.0; 3]);
    let feet = table(1.0).replace(&trunk, "TRUNK").replace("</link>", ball).replace("TRUNK", &trunk);
    let system = read("feet", &feet, None).expect("a robot");
    for link in 1..5 {
        let feet = system.robot.contact_points.iter().filter(|p| p.link == link && p.radius == 0.04).count();
        assert_eq!(feet, 1, "link {link} of {:?}", system.robot.contact_points);
    }
    assert!((system.default_state()[2] - 0.34).abs() < 1e-6, "stands at {} m", system.default_state()[2]);
    // A car on four wheels, however far they have turned.
    let mut car = trunk;
    for (k, [x, y]) in [[0.25, 0.2], [0.25, -0.2], [-0.25, 0.2], [-0.25, -0.2]].into_iter().enumerate() {
        let wheel = format!("wheel{k}");
        let round = "<geometry><cylinder radius=\"0.1\" length=\"0.05\"/></geometry>";
        let turned = "<collision><origin xyz=\"0 0 0\" rpy=\"1.5707963267948966 0 0\"/>";
        let text = body(&wheel, 0.5, [0.2, 0.05, 0.2], [0.0; 3]);
        let (inertial, _) = text.split_once("<collision>").expect("it has a shape");
        car += &format!("{inertial}{turned}{round}</collision></link>");
        car += &joint(&format!("axle{k}"), ["trunk", &wheel], [x, y, -0.05], 5.0).replace("revolute", "continuous");
    }
    let system = read("car", &format!("<robot name=\"car\">{car}</robot>"), None).expect("a robot");
    let scene = system.scene("plane").expect("a plane");
    for turn in [0.0, 0.5, 1.6, 3.1] {
        let mut batch = Batch::new(&system, &scene, 1);
        let mut state = system.default_state();
        state[7..11].fill(turn);
        batch.reset(0, &state);
        let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
        (0..60).for_each(|_| solver.step(&mut batch, &[0.0; 4]).expect("it stands"));
        assert!((batch.state(0)[2] - 0.15).abs() < 0.01, "wheels turned by {turn} rad: the car is at {} m, not 0.15", batch.state(0)[2]);
    }
}
