//! Robots that are like a built-in one: keys left out are the other's, own keys win, and what is no robot is refused in one line.
//! The robots `NAME-paper` are made so, and hold the reference simulator's materials and substeps.

use nerd_sim::prelude::*;
use nerd_sim::system::Spec;
use serde_json::Value;

use super::common::line;

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

/// `like` knows built-in robots alone, so a file cannot be like itself, and no circle can be said.
#[test]
fn what_is_no_built_in_robot_is_refused_in_one_line() {
    let urdf = System::texts("cartpole").expect("built in").1;
    for (text, word) in [
        ("like = \"mine\"", "mine"),
        ("like = [\"ant\"]", "choose from"),
        ("like = \"cartpole\"\nlegs = 4", "legs"),
        ("like = \"cartpole\"\nsubsteps = 0", "substeps"),
        ("like = \"cartpole\"\nsubsteps = \"many\"", "substeps"),
    ] {
        let error = line(System::from_text("mine", urdf, Some(text)));
        assert!(error.contains(word) && error.contains("`mine`"), "{text}: `{error}`");
    }
    let error = Spec::read("like = \"unicorn\"").expect_err("no robot");
    assert!(System::built_in().iter().all(|name| error.contains(name)), "the known ones are not named: {error}");
}
