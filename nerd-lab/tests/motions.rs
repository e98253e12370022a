//! How far solvers err along motions that none has seen: of whatever robot, and with losses told.

use nerd_lab::experiments::Experiment;
use nerd_lab::experiments::motions::{Motions, Moved, Row};
use nerd_train::device::Device;

fn asked(robot: &str) -> Motions {
    let mut asked = Motions::default();
    (asked.robot, asked.starts, asked.frames, asked.substeps) = (robot.into(), 2, 12, 2);
    asked
}

#[test]
fn a_robot_without_joints_is_measured_like_any_other() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let rod = folder.path().join("rod.toml");
    let toml = "[cable]\nlength = 0.5\ndiameter = 0.01\nmass = 0.1\nbending = 0.1\nlinks = 1\nheld = \"free\"\nat = [0.0, 0.0, 0.02]";
    std::fs::write(&rod, toml).expect("written");
    for robot in ["cube", rod.to_str().expect("utf-8")] {
        let moved = asked(robot).measure().unwrap_or_else(|error| panic!("{robot}: {error}"));
        assert_eq!(moved.rows.len(), 4, "{robot}: one and two substeps, and two that know no dynamics");
        assert!(moved.rows.iter().all(|row| row.lost == 0 && row.motions.len() == 2 && row.curve.len() == 12), "{robot}");
    }
}

#[test]
fn a_table_says_how_many_are_lost_and_has_no_figure_of_them() {
    let row = |motions: Vec<f64>, lost: usize| Row {
        series: "some".into(),
        substeps: Some(1),
        microseconds: Some(2.0),
        curve: if motions.is_empty() { Vec::new() } else { vec![0.001; 12] },
        motions,
        lost,
    };
    let table = |rows: Vec<Row>| {
        let moved = Moved { robot: "lead".into(), reference: "itself".into(), rows };
        asked("lead").tables(&moved).expect("a table").remove(0).markdown()
    };
    let (whole, lost) = (table(vec![row(vec![0.001; 2], 0)]), table(vec![row(vec![0.001], 1), row(vec![], 2)]));
    assert!(!whole.contains("were lost"), "{whole}");
    assert!(lost.contains("3 were lost") && !lost.contains("NaN") && lost.contains(" - "), "{lost}");
}

#[test]
fn what_is_asked_of_a_card_is_not_ignored_without_one() {
    let mut here = asked("cube");
    here.environments = Some(64);
    let said = here.measure().expect_err("it is refused").to_string();
    assert!(said.contains("--environments") && said.contains("--device cuda"), "{said}");
    let mut there = asked("cube");
    (there.device, there.frames) = (Device::Cuda, 5);
    let said = there.measure().expect_err("it is refused").to_string();
    assert!(said.contains("--frames 5") || said.contains("--features cuda"), "{said}");
}
