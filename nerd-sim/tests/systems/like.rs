//! TOMLs with `like`: keys left out are taken from the named robot, written keys win. The robots `NAME-paper` use
//! `like`.

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
        // `urdf` is not taken over.
        let differ = |a: &serde_json::Map<String, Value>| -> Vec<String> {
            a.keys().filter(|k| *k != "urdf" && a.get(*k) != theirs.get(*k)).cloned().collect()
        };
        assert_eq!(differ(&bare), [""; 0], "like {name}, and nothing said");
        assert_eq!(bare["urdf"], Value::Null, "like {name}");
        let own =
            keys(&read(&format!("like = \"{name}\"\nsubsteps = 77\ngravity = [0.0, 0.0, -1.5]\ntruth = \"rapier\"")));
        assert_eq!(differ(&own), ["gravity", "substeps", "truth"], "like {name}, three keys said");
        assert_eq!((&own["substeps"], &own["truth"]), (&77.into(), &"rapier".into()), "like {name}");
    }
}

#[test]
fn robots_of_the_paper_have_its_materials_and_substeps() {
    let material = |stiffness, damping, friction_damping, friction| Material {
        stiffness,
        damping,
        friction_damping,
        friction,
        ..Material::default()
    };
    // Materials of robot and ground, and substeps: the reference simulator's settings of these robots.
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
        let ground =
            paper.scene(paper.usual_scenes().into_iter().find(|s| *s != "free").expect("a ground")).expect("scene");
        assert_eq!([paper.spec.material, ground.colliders[0].material], materials, "{name}-paper");
        // Our tangential damping is larger.
        assert!(
            ours.spec.material.friction_damping > materials[0].friction_damping,
            "{name}: {:?}",
            ours.spec.material
        );
    }
}

/// Old keys of a robot's file give the same robot and the same hashes; old and new together are refused.
#[test]
fn old_keys_are_read_as_the_new_ones() {
    let family = (include_str!("../../assets/cube-family.toml"), include_str!("../../assets/cube-family.urdf"));
    let robots = ["ant", "anymal", "franka"].map(|name| (name, System::texts(name).expect("built in")));
    for (name, (spec, urdf)) in robots.into_iter().chain([("cube-family", family)]) {
        let names = [
            ("default_q = ", "default = "),
            ("stable_pd = ", "ahead = "),
            ("ang_vel = ", "angular = "),
            ("\nvelocity = ", "\nlinear = "),
            ("orientation_noise = ", "turn_noise = "),
        ];
        let old = names.iter().fold(spec.to_string(), |text, (new, old)| text.replace(new, old));
        assert_ne!(old, spec, "{name}");
        let [new, read] = [spec, &old].map(|text| System::from_text(name, urdf, Some(text)).expect(name));
        assert_eq!((new.sha256(), keys(&new.spec)), (read.sha256(), keys(&read.spec)), "{name}");
    }
    let (spec, urdf) = System::texts("ant").expect("built in");
    let both = spec.replacen("default_q = 1.0", "default_q = 1.0\ndefault = 1.0", 1);
    let said = System::from_text("ant", urdf, Some(&both)).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(
        said.contains("`default` is the old name of `default_q`, and both are given; leave `default` out"),
        "{said}"
    );
    let cable = "frame_time = 0.01\n[cable]\nlength = 1.0\ndiameter = 0.01\nmass = 0.1\nbending = 1e-3\nlinks = 4\n";
    let scene = "[[scene]]\nname = 'table'\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n";
    let [new, old] = [
        format!("{cable}support = 'fixed'\nposition = [0.0, 0.0, 1.0]\n{scene}box = [{{ size = [1.0, 1.0, 1.0], position = [3.0, 0.0, 0.0], yaw = 1.0 }}]\n"),
        format!("{cable}held = 'fixed'\nat = [0.0, 0.0, 1.0]\n{scene}box = [{{ size = [1.0, 1.0, 1.0], at = [3.0, 0.0, 0.0], turn = 1.0 }}]\n"),
    ]
    .map(|text| System::from_toml("lead", &text).expect("a cable"));
    assert_eq!((new.sha256(), keys(&new.spec)), (old.sha256(), keys(&old.spec)));
}

/// First digits of hashes from before keys had new names, as results have them.
const SHA256: [(&str, &str); 7] = [
    ("ant", "ec130d4d8f6429db"),
    ("ant-paper", "a004802dd5a276ea"),
    ("anymal", "2c25811c66bced4b"),
    ("anymal-family", "710f3ddc0a41ba45"),
    ("franka", "4b3ab896f91199c9"),
    ("pendulum-family", "7f62853a7dc2b706"),
    ("lead-pegs", "239c3e77e701b0b5"),
];

#[test]
fn new_keys_leave_the_hashes_of_robots() {
    for (name, sha256) in SHA256 {
        assert_eq!(&System::named(name).expect(name).sha256()[..16], sha256, "{name}");
    }
}
