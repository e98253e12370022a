//! What a replay shows of a cable and its scene, and how it tells motions apart.

use std::sync::Arc;

use nerd_lab::report::replay::{Replay, Solid};
use nerd_sim::prelude::*;

const SCENE: &str = "[[scene]]\nname = \"own\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n\
    box = [{ size = [0.4, 0.8, 0.1], at = [0.5, 0.0, 0.05] }]\npeg = [{ radius = 0.02, height = 0.1, at = [0.5, 0.1, 0.1] }]";

fn batch(held: &str) -> Batch {
    let cable = format!("[cable]\nlength = 0.7\ndiameter = 0.01\nmass = 0.1\nbending = 1e-3\nlinks = 7\nheld = \"{held}\"\n{SCENE}");
    let system = Arc::new(System::from_toml("cable", &cable).expect("a cable"));
    Batch::new(&system, &system.scene("own").expect("its scene"), 1)
}

#[test]
fn a_cable_is_shown_rod_by_rod_however_it_is_held() {
    for (held, grippers) in [("gripper", 1), ("fixed", 0), ("free", 0)] {
        let replay = Replay::new(held, &batch(held), 0.1);
        let (on_links, standing): (Vec<Solid>, Vec<Solid>) = replay.shapes.into_iter().partition(|solid| solid.link.is_some());
        let (rods, rest): (Vec<Solid>, Vec<Solid>) = on_links.into_iter().partition(|solid| solid.kind == "capsule");
        let length: f64 = rods.iter().map(|rod| 2.0 * rod.size[1]).sum();
        println!("{held}: {} rods, {length:.4} m, and {} beside", rods.len(), rest.len());
        assert!(rods.len() == 7 && (length - 0.7).abs() < 1e-9, "{held}");
        assert!(rods.iter().all(|rod| rod.size[0] == 0.005), "{held}: as thick as the cable");
        assert_eq!(rest.len(), grippers, "{held}");
        let kinds: Vec<&str> = standing.iter().map(|solid| solid.kind).collect();
        assert_eq!(kinds, ["box", "cylinder"], "{held}: what stands in the scene, but for the floor");
        assert_eq!(standing[1].size, [0.02, 0.05], "{held}: radius and half height of the peg");
        assert!((standing[1].pose[2] - 0.15).abs() < 1e-4, "{held}: it stands on the table");
    }
}

#[test]
fn motions_are_as_far_apart_as_their_contact_points() {
    let mut batch = batch("gripper");
    let mut replay = Replay::new("two", &batch, 0.1);
    let mut state = batch.state(0).to_vec();
    for (name, shift) in [("one", 0.0), ("other", 0.03)] {
        replay.begin(name);
        state[0] += shift;
        batch.reset(0, &state);
        replay.add(&batch);
    }
    replay.compare(&batch.system.robot);
    println!("moved by 0.03 m: {:?} m apart", replay.apart);
    assert!(replay.apart.len() == 1 && (replay.apart[0] - 0.03).abs() < 1e-6);
}
