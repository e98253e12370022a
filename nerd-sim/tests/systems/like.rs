//! Robots that are like a built-in one: keys left out are the other's, own keys win. The robots `NAME-paper` are made so.

use nerd_sim::prelude::*;
use nerd_sim::system::Spec;
use serde_json::Value;

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
