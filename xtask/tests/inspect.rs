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
    let shown = String::from_utf8_lossy(&xtask(&["inspect", path]).stdout).into_owned();
    assert!(shown.contains("pendulum: 300 tokens of 37 inputs and 4 targets") && shown.contains("contact depths (4)"), "{shown}");
    for (args, culprit) in [
        (vec!["inspect", "/nowhere"], "manifest.json"),
        (vec!["inspect"], "FOLDER"),
        (vec!["inspect", "--robot", "nobody"], "nobody"),
        (vec!["inspect", path, "--robot", "ant"], "`pendulum`"),
        (vec!["inspect", path, "--bound", "0"], "--bound"),
    ] {
        refused(&args, culprit);
    }
}

/// With a robot alone: its specification as TOML, which may stand beside its file.
#[test]
fn a_robot_alone_is_shown_as_toml() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("brick.urdf");
    let text = r#"<robot name="brick"><link name="brick"><inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
        </inertial><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link></robot>"#;
    std::fs::write(&path, text).expect("written");
    let shown = |robot: &str| {
        let run = xtask(&["inspect", "--robot", robot]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8(run.stdout).expect("utf-8")
    };
    let first = shown(path.to_str().expect("utf-8"));
    assert!(first.contains("free base") && first.contains("floating = true"), "{first}");
    std::fs::write(path.with_extension("toml"), &first).expect("written");
    let again = shown(path.to_str().expect("utf-8"));
    let keys = |text: &str| text.lines().filter(|l| !l.starts_with('#')).map(str::to_string).collect::<Vec<_>>();
    assert_eq!(keys(&first), keys(&again));
    assert!(shown("ant").contains("floating = true"));
}
