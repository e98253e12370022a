//! `dataset` and its folder: of two processes one writes there, and one that was killed leaves nothing that hinders the next.

mod common;

use std::path::Path;
use std::process::{Command, Stdio};

use common::{refused, xtask};

#[test]
fn a_folder_has_one_writer_at_a_time() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("data");
    let place = out.to_str().expect("utf-8");
    let mut first = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["dataset", "--robot", "pendulum", "--transitions", "1000000000", "--out", place])
        .stderr(Stdio::null())
        .spawn()
        .expect("started");
    while !out.join("shard-00000.safetensors").exists() {
        assert!(first.try_wait().expect("a state").is_none(), "the run ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let second = ["dataset", "--robot", "pendulum", "--transitions", "300", "--frames", "30", "--seed", "1", "--out", place];
    refused(&second, "in use");
    first.kill().expect("killed");
    first.wait().expect("ended");
    let run = xtask(&second);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let run = xtask(&["inspect", place]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

#[test]
fn what_is_refused_leaves_no_folder() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("data");
    for robot in ["unicorn", "/nowhere.urdf"] {
        refused(&["dataset", "--robot", robot, "--out", out.to_str().expect("utf-8")], robot);
        assert!(!Path::new(&out).exists(), "{robot} left a folder");
    }
}

#[test]
fn what_policies_do_and_passive_robots_are_recorded() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("data");
    let line = "dataset --robot cartpole --transitions 600 --frames 30 --torque-scale -1 --hold 4 --resets 0.5 --policy \
                models/policies/cartpole-swingup-neural-200 --policy-share 0.5 --out";
    let args: Vec<&str> = line.split_whitespace().chain([out.to_str().expect("utf-8")]).collect();
    let run = xtask(&args);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let shard = std::fs::read(out.join("shard-00000.safetensors")).expect("a shard");
    assert!(String::from_utf8_lossy(&shard).contains("cartpole-swingup"), "the shard does not say who acted in it");
    let other: Vec<&str> = args.iter().map(|w| if *w == "cartpole" { "cube" } else { w }).collect();
    refused(&other, "acts on `cartpole`");
}
