//! `inspect` on what `dataset` wrote: its files, and no data at all.

mod common;

use common::{refused, xtask};

#[test]
fn what_dataset_wrote_is_shown_and_other_data_get_one_line() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().to_str().expect("utf-8");
    for args in [vec!["dataset", "--robot", "pendulum", "--transitions", "300", "--frames", "30", "--out", path], vec!["inspect", path]] {
        let run = xtask(&args);
        assert!(run.status.success(), "{args:?}: {}", String::from_utf8_lossy(&run.stderr));
    }
    for kind in ["svg", "png"] {
        assert!(folder.path().join("inspect").with_extension(kind).metadata().is_ok_and(|m| m.len() > 1000), "no {kind}");
    }
    let text = std::fs::read(folder.path().join("inspect.json")).expect("inspect.json");
    let json: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    assert_eq!((&json["robot"], &json["counts"]["tokens"]), (&"pendulum".into(), &300.into()));
    assert!(json["provenance"]["commit"].is_string(), "{}", json["provenance"]);
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
