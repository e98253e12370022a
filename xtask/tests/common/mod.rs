//! The program as its users call it.

use std::path::Path;
use std::process::{Command, Output};

/// Runs it in the workspace's root.
pub fn xtask(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("workspace");
    Command::new(env!("CARGO_BIN_EXE_xtask")).args(args).current_dir(root).output().expect("xtask starts")
}

/// Runs what must be refused: exit code 2 and one line that names the culprit.
pub fn refused(args: &[&str], culprit: &str) {
    let run = xtask(args);
    let error = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{args:?}: {error}");
    assert!(error.trim_end().lines().count() == 1 && error.contains(culprit), "{args:?}: `{error}` is not one line that names {culprit}");
}

/// What the replays of a page show.
#[allow(dead_code, reason = "not every test opens a page")]
pub fn replays(page: &str) -> impl Iterator<Item = serde_json::Value> {
    let data = page.match_indices("{\"title\":").map(|(at, _)| &page[at..]);
    data.filter_map(|text| serde_json::Deserializer::from_str(text).into_iter().next()?.ok())
}

/// A replay has so many rods and pegs, and so many frames of NeRD and of its truth, which are apart.
#[allow(dead_code, reason = "not every test opens a page")]
pub fn shows_a_cable(replay: &serde_json::Value, rods: usize, pegs: usize, frames: usize) {
    let list = |key: &str| replay[key].as_array().expect(key).clone();
    let shapes = |kind: &str, on_link: bool| list("shapes").iter().filter(|s| s["kind"] == kind && s["link"].is_u64() == on_link).count();
    assert_eq!(shapes("capsule", true), rods, "rods");
    assert_eq!(shapes("box", true), 1, "grippers");
    assert_eq!(shapes("cylinder", false), pegs, "pegs");
    assert_eq!(list("planes").len(), 1, "floors");
    let tracks = list("tracks");
    assert!(tracks.len() == 2 && tracks[0]["name"] == "NeRD", "the learned cable, then its truth");
    assert!(tracks.iter().all(|track| track["poses"].as_array().is_some_and(|poses| poses.len() == frames)), "frames of both");
    let apart: Vec<f64> = list("apart").iter().filter_map(serde_json::Value::as_f64).collect();
    println!("{:.1} mm apart after {frames} frames", 1e3 * apart.last().unwrap_or(&f64::NAN));
    assert!(apart.len() == frames && apart[0] == 0.0 && apart[frames - 1] > 0.0, "from one start, and apart: {apart:?}");
}
