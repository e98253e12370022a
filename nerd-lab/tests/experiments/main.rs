//! Experiments on the smallest settings: measurements, refusals, and results on disk.

use nerd_cli::experiments::passive::{Case, Passive, Protocol, Row, Rows};
use nerd_cli::experiments::{Experiment, conduct};
use nerd_cli::report::{Artifact, Table, write_json};
use nerd_lab::experiments::motions::{MotionErrors, Motions, Row as MotionRow};
use nerd_lab::experiments::{family::Family, worth::unworthy};
use nerd_lab::report::manifest::{Entry as Made, Manifest};
use nerd_model::{base::Base, transformer::Storage};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport};
use nerd_train::settings::Settings;
use nerd_train::spec::SolverSpec;

mod calibrated;
#[path = "../../../nerd-model/tests/common/mod.rs"]
mod models;
mod policies;

/// The one-line message of a refusal.
fn refusal<T>(done: anyhow::Result<T>) -> String {
    let words = done.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(!words.is_empty() && !words.contains('\n'), "`{words}` is not one line");
    words
}

/// Settings by `NAME=VALUE`.
fn settings<T: Settings>(set: &[&str]) -> anyhow::Result<T> {
    let one = |text: &&str| {
        let (name, value) = text.split_once('=').expect("NAME=VALUE");
        let key = T::keys().into_iter().find(|key| key.name() == name).expect("a setting");
        Ok((name.into(), key.values.parse(value).map_err(anyhow::Error::msg)?))
    };
    T::default().with(&set.iter().map(one).collect::<anyhow::Result<_>>()?).map_err(anyhow::Error::msg)
}

/// The truth compared with itself, over a few frames.
fn truth(change: impl Fn(&mut Protocol)) -> Case {
    let solver = SolverSpec::default();
    let mut asked = Protocol::default();
    (asked.scene, asked.trajectories, asked.frames) = (vec!["ground1".into()], 2, Some(4));
    change(&mut asked);
    Case { robot: "pendulum".into(), solver, truth: None, asked }
}

#[test]
fn a_result_is_kept_as_it_was_measured_and_gives_way_to_none_with_less_behind_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaken = |starts| {
        Passive::new("shaken", &[truth(|asked| (asked.velocity_noise, asked.trajectories) = (0.01, starts))])
            .expect("asked")
    };
    let written = conduct(&shaken(3), folder.path()).expect("written");
    let refused = refusal(conduct(&shaken(2), folder.path()));
    assert!(
        refused.contains("shaken")
            && refused.contains("of 12 episodes or rollout frames, this run has 8; ask for as many (--episodes"),
        "{refused}"
    );
    conduct(&shaken(3), folder.path()).expect("as much is enough");
    let read = Artifact::read(folder.path(), "shaken").expect("read");
    let [found, measured] =
        [&read, &written].map(|result| result.parse::<Rows>().expect("its data").rows[0].report.error[0]);
    assert!(
        written.effort == 12.0 && (found / measured - 1.0).abs() < 1e-14,
        "{found} in the file, {measured} measured"
    );
    assert_eq!(read.inputs.changed(), Vec::<String>::new(), "nothing has changed since");
    assert!(folder.path().join("shaken/README.md").exists(), "its tables are beside it");
}

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

#[test]
fn the_summary_names_the_largest_of_a_robots_grounds_and_two_measurements_agree_by_their_errors() {
    let row = |scene: &str, error: f64| Row {
        robot: "pendulum".into(),
        method: "NeRD".into(),
        model: None,
        scene: scene.into(),
        truth: Truth::Articulated.name(),
        protocol: PassiveConfig { starts: 1, steps: 1, seed: 0, action: Action::Zero },
        report: PassiveReport {
            error: vec![error, error],
            standard_error: vec![0.0; 2],
            hold: vec![1.0; 2],
            curve: vec![error],
            diverged: 0,
            first_divergence: None,
            failed: 0,
        },
        paper: None,
        verdict: None,
    };
    let rows = Rows { rows: vec![row("free", 0.5), row("ground1", 0.1), row("ground2", 0.3), row("ground3", 0.2)] };
    let scenes: Vec<_> = rows.summary().rows.into_iter().map(|r| r[1].clone()).collect();
    assert_eq!(scenes, ["free", "ground2, the largest of 3"]);
    let other = Rows { rows: vec![row("free", 0.5), row("ground2", 0.4), row("ground9", 0.1)] };
    assert!(
        rows.agreement(&other)
            .is_some_and(|words| words.starts_with("1 of 2") && words.contains("pendulum in ground2"))
    );
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

#[test]
fn json_has_numbers_where_a_column_holds_nothing_else() {
    let header = ["name", "label", "error", "games", "verdict", "none"];
    let rows = [
        ["1e5", "007", "1.50 ± 0.5 / 2", "3", "1.00", "-"],
        ["nan", "nan", "-", "1.5e-3", "under 0.01", "-"],
        ["12", "8", "NaN +- 0.5", "-0.25", "2", "-"],
    ];
    let table = Table::new("some", header).with(rows.map(|row| row.map(String::from).to_vec()));
    let rows = serde_json::json!([
        { "name": "1e5", "label": "007", "error": [1.5, 0.5, 2.0], "games": 3.0, "verdict": "1.00", "none": null },
        { "name": "nan", "label": "nan", "error": null, "games": 0.0015, "verdict": "under 0.01", "none": null },
        { "name": "12", "label": "8", "error": [null, 0.5], "games": -0.25, "verdict": "2", "none": null },
    ]);
    assert_eq!(table.json(), rows);
}
