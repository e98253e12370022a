//! Shapes and distances that a replay page shows.

use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_train::replay::{Replay, Solid};

const SCENE: &str = "[[scene]]\nname = \"own\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n\
    box = [{ size = [0.4, 0.8, 0.1], position = [0.5, 0.0, 0.05] }]\npeg = [{ radius = 0.02, height = 0.1, position = [0.5, 0.1, 0.1] }]";

fn cable(held: &str) -> Batch {
    let cable = format!(
        "[cable]\nlength = 0.7\ndiameter = 0.01\nmass = 0.1\nbending = 1e-3\nlinks = 7\nheld = \"{held}\"\n{SCENE}"
    );
    let system = Arc::new(System::from_toml("cable", &cable).expect("a cable"));
    Batch::new(&system, &system.scene("own").expect("its scene"), 1)
}

#[test]
fn a_cable_is_shown_rod_by_rod_however_it_is_held() {
    for (held, grippers) in [("gripper", 1), ("fixed", 0), ("free", 0)] {
        let replay = Replay::new(held, &cable(held), 0.1);
        let (on_links, standing): (Vec<Solid>, Vec<Solid>) =
            replay.shapes.into_iter().partition(|solid| solid.link.is_some());
        let (rods, rest): (Vec<Solid>, Vec<Solid>) = on_links.into_iter().partition(|solid| solid.kind == "capsule");
        let length: f64 = rods.iter().map(|rod| 2.0 * rod.size[1]).sum();
        assert!(rods.len() == 7 && (length - 0.7).abs() < 1e-9, "{held}: {} rods, {length} m", rods.len());
        assert!(rods.iter().all(|rod| rod.size[0] == 0.005), "{held}: as thick as the cable");
        assert_eq!(rest.len(), grippers, "{held}");
        let kinds: Vec<&str> = standing.iter().map(|solid| solid.kind).collect();
        assert_eq!(kinds, ["box", "cylinder"], "{held}: what is in the scene, but for the floor");
    }
}

#[test]
fn motions_are_as_far_apart_as_their_contact_points() {
    let mut batch = cable("gripper");
    let mut replay = Replay::new("two", &batch, 0.1);
    let mut state = batch.state(0).to_vec();
    for (name, shift) in [("one", 0.0), ("other", 0.03)] {
        replay.begin(name);
        state[0] += shift;
        batch.reset(0, &state);
        replay.add(&batch);
    }
    replay.compare(&batch.system.robot);
    assert!(
        replay.apart.len() == 1 && (replay.apart[0] - 0.03).abs() < 1e-6,
        "moved by 0.03 m: {:?} m apart",
        replay.apart
    );
}

#[test]
fn a_robot_is_shown_by_its_own_shapes() {
    let folder = tempfile::tempdir().expect("a folder");
    // A prism of 0.4 x 0.2 x 0.1 m about (0.1, 0, 0), written at twice its size.
    let corner = |k: usize| format!("v {} {} {}\n", [-0.2, 0.6][k & 1], [-0.2, 0.2][k >> 1 & 1], [-0.1, 0.1][k >> 2]);
    std::fs::write(folder.path().join("prism.obj"), (0..8).map(corner).collect::<String>()).expect("written");
    let inertial =
        r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;
    let shape =
        |kind: &str, what: &str| format!(r#"<{kind}><origin xyz="0 0 1"/><geometry>{what}</geometry></{kind}>"#);
    let mesh = |file: &str| format!(r#"<mesh filename="{file}" scale="0.5 0.5 0.5"/>"#);
    let links = [
        ("seen", shape("visual", &mesh("prism.obj")) + &shape("collision", "<sphere radius=\"1\"/>")),
        ("lost", shape("visual", &mesh("lost.obj")) + &shape("collision", "<box size=\"1 1 1\"/>")),
        ("touched", shape("collision", &mesh("prism.obj"))),
        ("bare", String::new()),
    ];
    let chain = links.windows(2).map(|pair| {
        let (a, b) = (pair[0].0, pair[1].0);
        format!(
            r#"<joint name="{b}" type="continuous"><origin xyz="0 0 1"/><parent link="{a}"/><child link="{b}"/><axis xyz="0 1 0"/></joint>"#
        )
    });
    let joints: String = chain.collect();
    let links: String =
        links.iter().map(|(name, shapes)| format!(r#"<link name="{name}">{inertial}{shapes}</link>"#)).collect();
    let path = folder.path().join("robot.urdf");
    std::fs::write(&path, format!(r#"<robot name="r">{links}{joints}</robot>"#)).expect("written");
    let system = System::named(path.to_str().expect("a path")).expect("a robot");
    let shapes = Replay::new("r", &Batch::new(&system, &system.scene("free").expect("free"), 1), 0.1).shapes;
    let kinds: Vec<_> = shapes.iter().map(|solid| (solid.link, solid.kind)).collect();
    assert_eq!(
        kinds,
        [(None, "hull"), (Some(0), "box"), (Some(1), "hull"), (Some(2), "box")],
        "the first is the base, the last a lump"
    );
    let (prism, near) = (&shapes[0], |a: f64, b: f64| (a - b).abs() < 1e-4);
    let (corners, triangles) = prism.hull.as_ref().expect("a hull");
    assert!(prism.size.iter().zip([0.2, 0.1, 0.05]).all(|(a, b)| near(*a, b)), "half edges {:?}", prism.size);
    assert!(
        prism.pose[..3].iter().zip([0.1, 0.0, 1.0]).all(|(a, b)| near((*a).into(), b)),
        "its middle {:?}",
        prism.pose
    );
    assert_eq!((corners.len(), triangles.len()), (8, 12), "corners and triangles");
}
