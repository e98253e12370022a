//! Experiments on the smallest settings: measurements, refusals, and results on disk.

use nerd_cli::experiments::passive::{Case, Passive};
use nerd_cli::experiments::{Experiment, conduct};
use nerd_cli::report::{Artifact, write_json};
use nerd_lab::experiments::motions::{MotionErrors, Motions, Row as MotionRow};
use nerd_lab::experiments::{chart::Chart, family::Family, worth::unworthy};
use nerd_lab::report::manifest::{Entry as Made, Manifest};
use nerd_model::{base::Base, transformer::Storage};
use nerd_sim::prelude::*;
use nerd_train::spec::SolverSpec;

#[path = "../../../nerd-cli/tests/common/mod.rs"]
mod common;
#[path = "../../../nerd-model/tests/common/mod.rs"]
mod models;

use common::{settings, truth};

/// With weights 0 the model is its base alone. A model may ship once base and linear map both err five times as much.
#[test]
fn a_model_that_adds_nothing_is_not_shipped() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (results, all, mine) =
        (folder.path().join("results"), folder.path().join("models"), folder.path().join("models/mine"));
    let mut model = models::model(&System::named("pendulum").expect("built in"), Base::Trapezoid);
    model.weights.flat.fill(0.0);
    model.save(&mine, "nothing", Storage::F32).expect("saved");
    let made = Made {
        name: "passive".into(),
        about: String::new(),
        command: String::new(),
        made: None,
        record: false,
        stale: None,
    };
    let manifest = Manifest { artefact: vec![made] };
    let lines = || unworthy(&manifest, &results, &all).expect("readable");
    assert!(lines().len() == 1 && lines()[0].contains("no result has a verdict"), "{:?}", lines());
    let case = Case { solver: SolverSpec::neural(&mine), ..truth(|asked| asked.frames = Some(20)) };
    conduct(&Passive::new("passive", &[case]).expect("asked"), &results).expect("measured");
    assert!(lines().len() == 1 && lines()[0].contains("(constant velocity) errs 1.00 times"), "{:?}", lines());
    let mut result = Artifact::read(&results, "passive").expect("a result");
    let of = result.data["rows"][0]["verdict"].clone();
    for (base, linear, refused) in
        [(5.1, 4.9, "linear map errs 4.90"), (4.9, 5.1, "(constant velocity) errs 4.90"), (5.1, 5.1, "")]
    {
        for (row, times) in [("base", base), ("linear", linear)] {
            let errors = of["model"]["errors"].as_array().expect("errors").iter().filter_map(|e| e.as_f64());
            result.data["rows"][0]["verdict"][row]["errors"] = errors.map(|e| times * e).collect::<Vec<_>>().into();
        }
        write_json(&results.join("passive/result.json"), &result).expect("written");
        assert!(
            lines().len() == usize::from(!refused.is_empty()) && lines().iter().all(|l| l.contains(refused)),
            "{:?}",
            lines()
        );
    }
}

fn motions(robot: &str) -> Motions {
    let mut asked = Motions::default();
    (asked.robot, asked.trajectories, asked.frames, asked.max_substeps) = (robot.into(), 2, 12, 2);
    asked
}

#[test]
fn a_robot_without_joints_moves_like_any_other() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let rod = folder.path().join("rod.toml");
    let toml = "[cable]\nlength = 0.5\ndiameter = 0.01\nmass = 0.1\nbending = 0.1\nlinks = 1\nheld = \"free\"\nat = [0.0, 0.0, 0.02]";
    std::fs::write(&rod, toml).expect("written");
    for robot in ["cube", rod.to_str().expect("utf-8")] {
        let moved = motions(robot).errors().unwrap_or_else(|error| panic!("{robot}: {error}"));
        assert_eq!(moved.rows.len(), 4, "{robot}: one and two substeps, and two that know no dynamics");
        assert!(
            moved.rows.iter().all(|row| row.lost == 0 && row.motions.len() == 2 && row.curve.len() == 12),
            "{robot}"
        );
    }
}

#[test]
fn a_table_counts_lost_motions_and_has_no_figure_of_them() {
    let row = |motions: Vec<f64>, lost| {
        let curve = if motions.is_empty() { Vec::new() } else { vec![0.001; 12] };
        MotionRow { series: "some".into(), substeps: Some(1), microseconds: Some(2.0), curve, motions, lost }
    };
    let table = |rows| {
        motions("lead").table(&MotionErrors { robot: "lead".into(), reference: "itself".into(), rows }).markdown()
    };
    let (whole, lost) = (table(vec![row(vec![0.001; 2], 0)]), table(vec![row(vec![0.001], 1), row(vec![], 2)]));
    assert!(!whole.contains("were lost"), "{whole}");
    assert!(lost.contains("3 were lost") && !lost.contains("NaN") && lost.contains(" - "), "{lost}");
}

/// On a family, a solver with the drawn parameters errs less than a solver with the file's, and senseless settings are
/// refused.
#[test]
fn a_family_is_compared_by_the_frames_seen() {
    let small = ["trajectories=6", "frames=12", "context-frames=0,3,40", "evaluations=300"];
    let measured = settings::<Family>(&small).and_then(|family| family.measure()).expect("measured");
    let table = &measured.tables[0];
    let error =
        |row: usize, seen: usize| table.rows[row][1 + seen].split(' ').next().and_then(|x| x.parse::<f64>().ok());
    let names: Vec<&str> = table.rows.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
    let at = |row: usize| error(row, 2).expect("a number");
    assert!(at(2) < 0.7 * at(1) && at(1) < at(0), "told {}, described {}, still {}", at(2), at(1), at(0));
    // A solver without memory does not depend on the frames seen. Without any frame there is no calibrated solver.
    assert_eq!(error(0, 0), error(0, 2));
    assert!(error(3, 0).is_none() && at(3) < at(1), "calibrated {}, described {}", at(3), at(1));
    assert_eq!(measured.figures.len(), 1);
    for (set, why) in [
        ("robot=pendulum", "give its TOML a [vary]"),
        ("context-frames=-1", "whole numbers"),
        ("model=out/nothing", "out/nothing"),
    ] {
        let said = settings::<Family>(&[set, "trajectories=2", "frames=2", "context-frames=1", "evaluations=0"])
            .and_then(|family| family.measure().map(|_| ()));
        let said = said.expect_err(set).to_string();
        assert!(said.contains(why), "{set}: {said}");
    }
}

/// rapier has no dry friction: it is left out, and the other solvers go on.
#[test]
fn a_solver_that_cannot_is_left_out_of_a_chart() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("dry.urdf"), common::DRY).expect("written");
    let mut chart = Chart::default();
    (chart.robot, chart.trajectories, chart.frames, chart.max_substeps) =
        (folder.path().join("dry.urdf").display().to_string(), 1, 2, 4);
    chart.about().expect("a chart");
    let measured = chart.measure().expect("a chart");
    let series: Vec<_> = measured.tables[0].rows.iter().map(|row| row[0].clone()).collect();
    assert!(series.len() > 1 && series.iter().all(|s| s.starts_with("articulated")), "{series:?}");
}
