//! Robots that are like a built-in one: keys left out are the other's, own keys win. The robots `NAME-paper` are made so.

use nerd_sim::{prelude::*, system::Spec};
use serde_json::Value;

use super::common::built_in;

fn keys(spec: &Spec) -> serde_json::Map<String, Value> {
    serde_json::to_value(spec).expect("JSON").as_object().expect("a table").clone()
}

fn read(text: &str) -> Spec {
    Spec::read(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

#[test]
fn keys_left_out_are_the_others_and_own_keys_win() {
    for name in System::built_in() {
        let theirs = keys(&read(System::texts(name).expect("built in").0));
        let bare = keys(&read(&format!("like = \"{name}\"")));
        // Its URDF is the other's alone.
        let differ = |a: &serde_json::Map<String, Value>| -> Vec<String> {
            a.keys().filter(|k| *k != "urdf" && a.get(*k) != theirs.get(*k)).cloned().collect()
        };
        assert_eq!(differ(&bare), [""; 0], "like {name}, and nothing said");
        assert_eq!(bare["urdf"], Value::Null, "like {name}");
        let own = keys(&read(&format!("like = \"{name}\"\nsubsteps = 77\ngravity = [0.0, 0.0, -1.5]\ntruth = \"rapier\"")));
        assert_eq!(differ(&own), ["gravity", "substeps", "truth"], "like {name}, three keys said");
        assert_eq!((&own["substeps"], &own["truth"]), (&77.into(), &"rapier".into()), "like {name}");
    }
}

#[test]
fn robots_of_the_paper_have_its_materials_and_substeps() {
    let material =
        |stiffness, damping, friction_damping, friction| Material { stiffness, damping, friction_damping, friction, ..Material::default() };
    // Robot's and ground's; substeps (the reference simulator's settings of these robots).
    let cases = [
        ("cartpole", None, 5),
        ("pendulum", Some([material(1e4, 1e3, 1e4, 0.5); 2]), 5),
        ("cube", Some([material(1e4, 1e3, 50.0, 0.15); 2]), 20),
        ("franka", None, 9),
        ("ant", Some([material(4e4, 100.0, 3e3, 0.75), material(1e5, 1e3, 1e3, 0.5)]), 16),
        ("anymal", Some([material(2e3, 500.0, 100.0, 0.75), material(1e5, 1e3, 1e3, 0.5)]), 10),
    ];
    for (name, materials, substeps) in cases {
        let (ours, paper) = (built_in(name), built_in(&format!("{name}-paper")));
        assert_eq!((ours.spec.truth, paper.spec.truth), (Truth::Articulated, Truth::Paper), "{name}");
        assert_eq!(paper.spec.substeps, substeps, "{name}-paper");
        assert_ne!(ours.robot_sha256(), paper.robot_sha256(), "{name} and {name}-paper are one robot to a model");
        let Some(materials) = materials else { continue };
        let ground = paper.scene(paper.usual_scenes().into_iter().find(|s| *s != "free").expect("a ground")).expect("scene");
        assert_eq!([paper.spec.material, ground.colliders[0].material], materials, "{name}-paper");
        // What is ours holds more.
        assert!(ours.spec.material.friction_damping > materials[0].friction_damping, "{name}: {:?}", ours.spec.material);
    }
}
