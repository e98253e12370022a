//! What a data set holds: every number is in a bar, and a trajectory that no learner should see is left out and counted.

use std::path::Path;
use std::sync::Arc;

use nerd_lab::inspect::{Block, Inspection};
use nerd_sim::dataset::{GenerateConfig, Manifest, generate, read_shard, sha256_of, write_shard};
use nerd_sim::prelude::*;

/// Ten trajectories of 30 frames.
fn data(robot: &str, folder: &Path) -> (Arc<System>, Manifest) {
    let system = System::named(robot).expect("built in");
    let config = GenerateConfig { transitions: 300, frames: 30, ..Default::default() };
    let truth = Truth::default();
    let manifest = generate(&system, &mut *truth.solver(&system), &truth.name(), &config, folder, &mut |_, _| ()).expect("written");
    (system, manifest)
}

#[test]
fn every_number_of_a_data_set_is_in_a_bar() {
    for (robot, inputs, targets) in [("pendulum", 37, 4), ("ant", 215, 29)] {
        let folder = tempfile::tempdir().expect("temporary folder");
        let (system, manifest) = data(robot, folder.path());
        let found = Inspection::of(folder.path(), &manifest, &system, 1e3).expect("looked through");
        let (counts, mut seen) = (&found.counts, 0);
        assert_eq!((counts.trajectories, counts.tokens), (10, 300), "{robot}");
        assert_eq!(found.columns.len(), inputs + targets, "{robot}");
        for column in &found.columns {
            let bars: u64 = column.bars.iter().sum();
            assert_eq!(bars, column.count, "{robot}: {column:?}");
            if column.block == Block::Depth {
                seen += bars;
            } else if column.contact.is_none() {
                assert_eq!(bars, 300, "{robot}: {column:?}");
            }
        }
        assert_eq!(seen, counts.points_seen, "{robot}");
        assert_eq!(counts.wraps.len(), if robot == "pendulum" { 2 } else { 0 }, "{robot}: endless joints");
    }
}

#[test]
fn a_trajectory_that_is_no_number_or_beyond_the_bound_is_left_out_and_counted() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (system, mut manifest) = data("pendulum", folder.path());
    let path = folder.path().join("shard-00000.safetensors");
    let (mut recording, header) = read_shard(&path).expect("a shard");
    let row = recording.states.len() / recording.trajectories;
    recording.states[2 * row + 5] = f64::NAN;
    recording.states[7 * row + 3] = 1e300;
    write_shard(&path, &recording, &header).expect("written");
    let refused = |manifest: &Manifest, bound: f64, words: &str| {
        let said = Inspection::of(folder.path(), manifest, &system, bound).expect_err("refused").to_string();
        assert!(said.contains(words) && said.contains(&folder.path().display().to_string()), "`{said}` does not name {words}");
    };
    // As training does, it refuses shards that its manifest was not written for.
    refused(&manifest, 1e3, "SHA-256");
    manifest.sha256 = sha256_of([recording.sha256()]);
    // Numbers whose mean is none are no figures.
    refused(&manifest, 1e305, "--bound 1");
    let counts = Inspection::of(folder.path(), &manifest, &system, 1e3).expect("looked through").counts;
    assert_eq!((counts.not_finite, counts.beyond, counts.tokens), (1, 1, 240), "{counts:?}");
}

#[test]
fn a_manifest_that_says_other_lengths_than_its_shards_have_is_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (system, manifest) = data("pendulum", folder.path());
    for (trajectories, frames) in [(11, 30), (10, 31)] {
        let other = Manifest { trajectories, frames, ..manifest.clone() };
        let said = Inspection::of(folder.path(), &other, &system, 1e3).expect_err("refused").to_string();
        assert!(said.contains("its shards hold 10 of 30"), "{said}");
        std::fs::write(folder.path().join("manifest.json"), serde_json::to_string(&other).expect("JSON")).expect("written");
        let said =
            nerd_train::prepare::read(&system, &other.truth, folder.path(), 1, nerd_model::base::Base::State).err().expect("refused");
        assert!(said.to_string().contains("its shards hold 10 of 30"), "{said}");
    }
}
