//! `train` as its users meet it: what cannot be is refused at once and by name, before anything is recorded or written; a run
//! is continued as itself alone; what a killed run leaves is no obstacle.

mod common;

use std::path::Path;

use common::{refused, xtask};

/// A run of seconds, in `out`.
fn small<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let options = "train --robot cartpole --recipe small --transitions 20000 --updates 6 --batch 16 --rollouts 2 --validate-every 3 --out";
    options.split(' ').chain([out]).chain(more.iter().copied()).collect()
}

fn trained(args: &[&str]) -> String {
    let run = xtask(args);
    let said = String::from_utf8_lossy(&run.stderr).to_string();
    assert!(run.status.success(), "{args:?}: {said}");
    said
}

#[test]
fn what_cannot_be_trained_is_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let out = out.to_str().expect("utf-8");
    let most = u64::MAX.to_string();
    for (options, culprit) in [
        ("--layers 1000000000", "--layers"),
        ("--layers 0", "--layers"),
        ("--embedding 1000000000", "--embedding"),
        ("--embedding 50", "heads"),
        ("--history 0", "--history"),
        ("--stream --sequence 1000000000", "--sequence"),
        ("--frames 0", "--frames"),
        ("--frames 5", "--frames"),
        (&format!("--fresh {most}"), "--fresh"),
        ("--fresh 900000000 --updates 10", "--fresh"),
        (&format!("--transitions {most}"), "--transitions"),
        ("--batch 0", "--batch"),
        (&format!("--batch {most}"), "--batch"),
        ("--updates 0", "--updates"),
        ("--rate=-1", "--rate"),
        ("--rate nan", "--rate"),
        ("--last-rate inf", "--last-rate"),
        ("--average 2", "--average"),
        ("--average 1", "average"),
        ("--policy-share 2", "--policy-share"),
        ("--tail nan", "--tail"),
        ("--huber=-0.1", "huber"),
        ("--huber nan", "huber"),
        ("--torque-scale nan", "--torque-scale"),
        ("--resets 1.5", "--resets"),
        ("--hold 0", "--hold"),
        (&format!("--hold {most}"), "--hold"),
        (&format!("--rollouts {most}"), "--rollouts"),
        ("--minutes nan", "--minutes"),
        ("--minutes=-3", "--minutes"),
        (&format!("--seed {most}"), "--seed"),
        ("--f32", "--device cuda"),
        ("--from models/cartpole-paper", "--from"),
        ("--from models/pendulum-paper", "cartpole"),
        ("--from /nowhere", "/nowhere"),
        ("--data /nowhere", "/nowhere"),
        ("--data /nowhere --fresh 1000", "--fresh"),
    ] {
        let args: Vec<&str> =
            "train --robot cartpole-paper --recipe small --out".split(' ').chain([out]).chain(options.split(' ')).collect();
        refused(&args, culprit);
        assert!(!Path::new(out).exists(), "{args:?} left something");
    }
    let file = folder.path().join("my.toml");
    std::fs::write(&file, "robot = \"cartpole\"\nhurry = 1\n").expect("written");
    let file = file.to_str().expect("utf-8");
    for culprit in ["my.toml", "`hurry`"] {
        refused(&["train", file, "--out", out], culprit);
    }
    refused(&["train", file, "--recipe", "cartpole", "--out", out], "--recipe");
    assert!(!Path::new(out).exists(), "a file with an unknown key left something");
}

#[test]
fn a_run_is_continued_as_itself_alone_and_both_sides_are_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let out = out.to_str().expect("utf-8");
    trained(&small(out, &[]));
    for (more, words) in [
        (["--rate", "0.002"], ["0.001", "0.002"]),
        (["--hold", "2"], ["`hold` was 1", "2 now"]),
        (["--rollouts", "3"], ["`rollouts` was 2", "3 now"]),
        (["--frames", "50"], ["`frames` was 100", "50 now"]),
    ] {
        let options: Vec<&str> =
            small(out, &[]).into_iter().filter(|w| more[0] != "--rollouts" || (*w != "--rollouts" && *w != "2")).collect();
        words.iter().for_each(|word| refused(&[&options[..], &more].concat(), word));
    }
}

#[test]
fn what_a_killed_run_leaves_is_said_by_name() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let place = out.to_str().expect("utf-8");
    trained(&small(place, &[]));
    let card = std::fs::read(out.join("model/config.json")).expect("a model");
    // A line cut short: its minutes are missing, the model is not.
    let sessions = out.join("sessions.jsonl");
    let text = std::fs::read_to_string(&sessions).expect("sessions");
    std::fs::write(&sessions, format!("{text}{{\"first\": 6, \"la")).expect("written");
    std::fs::remove_dir_all(out.join("model")).expect("removed");
    let said = trained(&small(place, &[]));
    assert!(said.contains("sessions.jsonl, line"), "{said}");
    let config: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("model/config.json")).expect("a model")).expect("JSON");
    let before: serde_json::Value = serde_json::from_slice(&card).expect("JSON");
    assert_eq!(config["model_sha256"], before["model_sha256"], "another model");
    assert!(config["robot_sha256"].as_str().is_some_and(|h| h.len() == 64), "{config}");
    let best = out.join("best.safetensors");
    let bytes = std::fs::read(&best).expect("weights");
    let mut changed = bytes.clone();
    *changed.last_mut().expect("bytes") ^= 1;
    for damaged in [&bytes[..bytes.len() / 2], &changed[..]] {
        std::fs::write(&best, damaged).expect("written");
        let run = xtask(&small(place, &["--finish"]));
        let said = String::from_utf8_lossy(&run.stderr).to_string();
        assert!(run.status.code() == Some(2) && said.contains("best.safetensors is damaged"), "{said}");
    }
}

#[test]
fn time_that_is_over_says_what_to_do() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let out = out.to_str().expect("utf-8");
    let said = trained(
        &small(out, &["--minutes", "0.0001", "--seed", "4"]).iter().map(|w| if *w == "6" { "1000000" } else { w }).collect::<Vec<_>>(),
    );
    assert!(said.contains("stopped at update") && (said.contains("--finish") || said.contains("first validation")), "{said}");
}

#[test]
fn a_model_that_names_no_robot_is_stamped_and_then_taken() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let model = folder.path().join("cartpole");
    std::fs::create_dir(&model).expect("made");
    for name in ["config.json", "normalizer.json", "model.safetensors"] {
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/cartpole-paper").join(name), model.join(name)).expect("copied");
    }
    let path = model.join("config.json");
    let mut config: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).expect("read")).expect("JSON");
    config.as_object_mut().expect("an object").retain(|key, _| !key.ends_with("_sha256") || key == "data_sha256");
    std::fs::write(&path, config.to_string()).expect("written");
    let place = model.to_str().expect("utf-8");
    let evaluate = ["evaluate", "--robot", "cartpole-paper", "--solver", "neural", "--model", place, "--starts", "2", "--frames", "2"];
    refused(&evaluate, "cargo xtask stamp");
    let stamp = || String::from_utf8_lossy(&xtask(&["stamp", folder.path().to_str().expect("utf-8")]).stdout).to_string();
    let said = stamp();
    assert!(said.contains("robot not known -> "), "{said}");
    assert!(xtask(&evaluate).status.success());
    assert!(stamp().contains("as it was"));
    let empty = tempfile::tempdir().expect("temporary folder");
    refused(&["stamp", empty.path().to_str().expect("utf-8")], "no model");
}

#[test]
fn a_file_says_what_options_say_and_options_go_before_it() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_string();
    let text = "robot = \"cartpole\"\nembedding = 48\nlayers = 2\nhead-width = 12\nblock = 16\nvalidation-windows = 4096\nlog-every = 20\n\
                transitions = 20000\nupdates = 600\nbatch = 16\nrollouts = 2\nvalidate-every = 3\n";
    std::fs::write(path("my.toml"), text).expect("written");
    let (file, line) = (path("file"), path("line"));
    trained(&["train", &path("my.toml"), "--updates", "6", "--out", &file]);
    trained(&small(&line, &[]));
    let weights = |out: &str| std::fs::read(Path::new(out).join("model/model.safetensors")).expect("weights");
    assert!(weights(&file) == weights(&line), "the same settings, from a file and from options, led to other weights");
}
