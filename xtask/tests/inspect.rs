//! `inspect` on what `dataset` wrote: the counts, the columns, a trajectory that no learner should see, and no data at all.

mod common;

use std::path::Path;

use common::{refused, xtask};
use nerd_sim::dataset::{Recording, read_shard, sha256_of, write_shard};

fn data(robot: &str, folder: &Path) {
    let out = folder.to_str().expect("utf-8");
    let run = xtask(&["dataset", "--robot", robot, "--transitions", "300", "--frames", "30", "--out", out]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

fn inspect(folder: &Path) -> serde_json::Value {
    let run = xtask(&["inspect", folder.to_str().expect("utf-8")]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    for kind in ["svg", "png"] {
        assert!(folder.join("inspect").with_extension(kind).metadata().is_ok_and(|m| m.len() > 1000), "no {kind}");
    }
    serde_json::from_slice(&std::fs::read(folder.join("inspect.json")).expect("inspect.json")).expect("JSON")
}

#[test]
fn every_number_of_a_data_set_is_in_a_bar() {
    for (robot, inputs, targets) in [("pendulum", 37, 4), ("ant", 215, 29)] {
        let folder = tempfile::tempdir().expect("temporary folder");
        data(robot, folder.path());
        let json = inspect(folder.path());
        let counts = &json["counts"];
        assert_eq!((&counts["trajectories"], &counts["tokens"]), (&10.into(), &300.into()), "{robot}");
        let columns = json["columns"].as_array().expect("columns");
        assert_eq!(columns.len(), inputs + targets, "{robot}");
        let mut seen = 0;
        for column in columns {
            let bars: u64 = column["bars"].as_array().expect("bars").iter().filter_map(|b| b.as_u64()).sum();
            assert_eq!(Some(bars), column["count"].as_u64(), "{robot}: {column}");
            if column["block"] == "depth" {
                seen += bars;
            } else if column["contact"].is_null() {
                assert_eq!(bars, 300, "{robot}: {column}");
            }
        }
        assert_eq!(Some(seen), counts["points_seen"].as_u64(), "{robot}");
        let wraps = counts["wraps"].as_array().expect("wraps").len();
        assert_eq!(wraps, if robot == "pendulum" { 2 } else { 0 }, "{robot}: endless joints");
    }
}

#[test]
fn a_trajectory_that_is_no_number_or_beyond_the_bound_is_left_out_and_counted() {
    let folder = tempfile::tempdir().expect("temporary folder");
    data("pendulum", folder.path());
    let path = folder.path().join("shard-00000.safetensors");
    let place = folder.path().to_str().expect("utf-8");
    let (mut recording, header) = read_shard(&path).expect("a shard");
    let row = recording.states.len() / recording.trajectories;
    let manifest = folder.path().join("manifest.json");
    let allow = |recording: &Recording| {
        let mut said: serde_json::Value = serde_json::from_slice(&std::fs::read(&manifest).expect("manifest")).expect("JSON");
        said["sha256"] = sha256_of([recording.sha256()]).into();
        std::fs::write(&manifest, said.to_string()).expect("written");
    };
    recording.states[2 * row + 5] = f64::NAN;
    recording.states[7 * row + 3] = 1e300;
    write_shard(&path, &recording, &header).expect("written");
    // As `train --data` does, it refuses shards that its manifest was not written for.
    refused(&["inspect", place], "SHA-256");
    allow(&recording);
    // Numbers whose mean is none are no figures.
    refused(&["inspect", place, "--bound", "1e305"], "--bound 1");
    let json = inspect(folder.path());
    let counts = &json["counts"];
    assert_eq!((&counts["not_finite"], &counts["beyond"], &counts["tokens"]), (&1.into(), &1.into(), &240.into()), "{counts}");
}

#[test]
fn no_data_and_other_data_get_one_line() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().to_str().expect("utf-8");
    data("pendulum", folder.path());
    for (args, culprit) in [
        (vec!["inspect", "/nowhere"], "manifest.json"),
        (vec!["inspect"], "FOLDER"),
        (vec!["inspect", path, "--robot", "ant"], "`pendulum`"),
        (vec!["inspect", path, "--bound", "0"], "--bound"),
        (vec!["tosses", "--data", path], "no toss data"),
        (vec!["tosses", "--data", path, "--every", "0"], "--every"),
    ] {
        refused(&args, culprit);
    }
}

#[test]
fn a_manifest_that_says_other_lengths_than_its_shards_have_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    data("pendulum", folder.path());
    let place = folder.path().to_str().expect("utf-8");
    let manifest = folder.path().join("manifest.json");
    let whole = std::fs::read_to_string(&manifest).expect("manifest");
    for key in ["trajectories", "frames"] {
        let mut said: serde_json::Value = serde_json::from_str(&whole).expect("JSON");
        said[key] = (said[key].as_u64().expect("a count") + 1).into();
        std::fs::write(&manifest, said.to_string()).expect("written");
        refused(&["inspect", place], "its shards hold");
        let out = folder.path().join("run");
        let train = ["train", "--robot", "pendulum", "--recipe", "small", "--data", place, "--out", out.to_str().expect("utf-8")];
        refused(&train, "its shards hold");
    }
}
