//! What the program says of itself: lists, JSON, completions, the reference.

mod common;

use std::path::Path;
use std::process::Command;

use common::{refused, xtask};
use serde_json::Value;

fn said(args: &[&str]) -> String {
    let run = xtask(args);
    assert!(run.status.success(), "{args:?}: {}", String::from_utf8_lossy(&run.stderr));
    String::from_utf8(run.stdout).expect("utf-8")
}

#[test]
fn lists_have_what_can_be_named_and_json_the_same_rows() {
    for (list, names) in [
        ("robots", ["pendulum", "anymal-paper"]),
        ("scenes", ["ground6", "hills"]),
        ("tasks", ["ant-run", "franka-reach-torque"]),
        ("models", ["models/ant-paper", "models/pendulum-paper"]),
        ("rows", ["free fall", "ANYmal kp 2000"]),
    ] {
        let text = said(&["list", list]);
        let json: Value = serde_json::from_str(&said(&["list", list, "--json"])).expect("JSON and nothing else");
        let rows = json[list].as_array().expect("rows");
        assert_eq!(rows.len() + 2, text.trim().lines().count(), "{text}");
        for name in names {
            let has = |row: &Value| row.as_object().is_some_and(|row| row.values().any(|cell| cell == name));
            assert!(text.contains(&format!("| {name} ")) && rows.iter().any(has), "no {name} in {text}");
        }
    }
    refused(&["list", "horses"], "horses");
    refused(&["dataset", "--robot", "pendulum", "--out", "/dev/null/x", "--json"], "--json");
}

#[test]
fn models_and_results_are_found_from_any_folder_of_the_workspace() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let out = Command::new(env!("CARGO_BIN_EXE_xtask")).args(["list", "models"]).current_dir(&folder).output().expect("started");
    assert_eq!(String::from_utf8_lossy(&out.stdout), said(&["list", "models"]));
    let outside = tempfile::tempdir().expect("temporary folder");
    let out = Command::new(env!("CARGO_BIN_EXE_xtask")).args(["list", "models", "--json"]).current_dir(outside.path()).output();
    let rows: Value = serde_json::from_slice(&out.expect("started").stdout).expect("JSON");
    assert_eq!(rows["models"].as_array().map(Vec::len), Some(0), "there are none outside");
}

#[test]
fn every_shell_has_completions() {
    for shell in ["bash", "zsh", "fish"] {
        let script = said(&["completions", shell]);
        assert!(["evaluate", "torque-scale", "robots"].iter().all(|word| script.contains(word)), "{shell}: {script}");
    }
}

#[test]
fn the_reference_is_that_of_this_program() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("commands.md");
    said(&["reference", "--out", path.to_str().expect("utf-8")]);
    let [now, committed] = [&path, &Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/commands.md")].map(std::fs::read_to_string);
    let (now, committed) = (now.expect("written"), committed.expect("docs/commands.md"));
    let differs = now.lines().zip(committed.lines()).find(|(a, b)| a != b);
    assert!(now == committed, "docs/commands.md is of another program; write it with `cargo xtask reference`: {differs:?}");
}
