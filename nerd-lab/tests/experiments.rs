//! Experiments on the smallest settings: measurements, refusals, and results on disk.

use std::path::Path;

use nerd_lab::experiments::calibrated::{CalibratedAll, Calibration, Runs};
use nerd_lab::experiments::motions::{MotionErrors, Motions, Row as MotionRow};
use nerd_lab::experiments::passive::{Case, Passive, Protocol, Row, Rows, unworthy};
use nerd_lab::experiments::{Experiment, conduct, family::Family, policies};
use nerd_lab::report::manifest::{Entry as Made, Manifest};
use nerd_lab::report::{Artifact, Inputs, Table, write_json};
use nerd_lab::{experiments::chart::Chart, experiments::games::games};
use nerd_model::{base::Base, transformer::Storage};
use nerd_sim::prelude::*;
use nerd_tasks::named;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport};
use nerd_train::ppo::{Arena, Policy, PpoConfig, Shape};
use nerd_train::settings::Settings;
use nerd_train::spec::SolverSpec;

#[path = "../../nerd-model/tests/common/mod.rs"]
mod models;

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

#[test]
fn tosses_that_nothing_was_fitted_to_are_predicted_better() {
    let mut settings = Calibration::default();
    settings.log = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/cube.log.toml")];
    (settings.solver, settings.splits, settings.frames, settings.every) = (vec!["articulated".into()], 3, 40, 16);
    (settings.evaluations, settings.rollouts) = (60, 24);
    settings.parameters = vec!["com.z".into(), "damping".into(), "lag".into()];
    // Models beside: one that adds nothing to the state, one of random weights that remembers, and one of another
    // robot.
    let (folder, cubes) = (tempfile::tempdir().expect("a folder"), System::named("cube-family").expect("built in"));
    let save = |name: &str, model: nerd_model::folder::Model| {
        let path = folder.path().join(name);
        model.save(&path, name, Storage::F32).expect("saved");
        path
    };
    let mut still = models::model(&cubes, Base::State);
    still.weights.flat.fill(0.0);
    // The identity quaternion: no rotation.
    still.normalizer.outputs.mean[6] = 1.0;
    let other = save("other", models::model(&System::named("pendulum").expect("built in"), Base::State));
    settings.model = vec![other];
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("of another robot than the log"), "{reason}");
    let mut remembers = models::placed(&cubes, Base::State, nerd_model::transformer::Positions::Rotary);
    remembers.normalizer.outputs =
        nerd_model::normalizer::Moments { variance: vec![1e-8; 13], ..still.normalizer.outputs.clone() };
    settings.model = vec![save("still", still), save("remembers", remembers)];
    let measured = settings.measure().expect("a calibration");
    let found: CalibratedAll = serde_json::from_value(measured.data.into()).expect("its data");
    let splits = &found.fitted[0].splits;
    assert!(splits.len() == 3 && splits.iter().any(|s| s.judged != splits[0].judged), "three splits of one kind");
    for split in splits {
        assert_eq!(split.judged.len(), 2, "half of the three tosses that 68 % of ten leave");
        assert!(split.fit.objective < 1.0, "the objective is {} of that without a fit", split.fit.objective);
        let [low, mean, high] = [&split.after.low, &split.after.mean, &split.after.high].map(|g| g.position);
        assert!(low <= mean && mean <= high, "{mean} m is not between {low} and {high}");
    }
    for (k, motionless) in found.still.iter().enumerate() {
        let [still, remembers] = &found.modelled[..] else { panic!("two models") };
        let apart = |g: &nerd_sim::calibrate::Distance| {
            (g.position - motionless.mean.position).abs() + (g.rotation - motionless.mean.rotation).abs()
        };
        assert!(apart(&still.shown[k].mean) < 1e-9 && apart(&still.withheld[k].mean) < 1e-9, "what adds nothing stays");
        let [shown, withheld] = [&remembers.shown[k].mean, &remembers.withheld[k].mean].map(|g| g.position);
        assert!(shown != withheld && shown.is_finite() && withheld.is_finite(), "shown {shown}, withheld {withheld}");
    }
    let text: String = measured.tables.iter().map(|table| table.markdown()).collect();
    assert!(
        ["no motion", "articulated(substeps=4), calibrated", "com.z (m)", "still, shown none"]
            .iter()
            .all(|word| text.contains(word)),
        "{text}"
    );
}

/// Five runs of a real double pendulum, with encoder zeros set by hand.
#[test]
fn what_a_run_has_of_its_own_is_told_by_its_first_frames() {
    let mut settings = Calibration::default();
    settings.log = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("../nerd-sim/assets/logs/double-pendulum.log.toml")];
    let names = |all: &[&str]| all.iter().map(|name| name.to_string()).collect::<Vec<_>>();
    settings.per_trajectory = names(&["zero:shoulder", "zero:elbow"]);
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("--per-trajectory, --regularized and --context-frames belong together"), "{reason}");
    settings.parameters = names(&[
        "com.z:upper",
        "com.z:lower",
        "inertia:upper",
        "joint-friction:shoulder",
        "joint-friction:elbow",
        "delay",
    ]);
    settings.regularized = names(&["joint-friction:elbow", "strength:elbow"]);
    (settings.context_frames, settings.frames, settings.every, settings.splits) = (300, 60, 60, 2);
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("too few folds"), "{reason}");
    settings.solver = vec!["rapier".into()];
    let reason = refusal(settings.measure().map(drop));
    assert!(reason.contains("--solver says nothing"), "{reason}");
    settings.solver = Calibration::default().solver;
    (settings.splits, settings.every, settings.evaluations, settings.rollouts) = (3, 30, 400, 60);
    let measured = settings.measure().expect("a calibration");
    let found: Runs = serde_json::from_value(measured.data.into()).expect("its data");
    let mut ids: Vec<u64> = found.judged.iter().map(|run| run.id).collect();
    ids.sort_unstable();
    assert_eq!(
        (ids, found.lengths.clone(), found.weights.len()),
        (vec![10, 11, 12, 13, 17], vec![30, 60, 120], 3),
        "each once"
    );
    let error =
        |method: usize, length: usize| found.judged.iter().map(|run| run.errors[method][length]).sum::<f64>() / 5.0;
    let all: Vec<f64> = (0..6).map(|method| error(method, 1)).collect();
    println!("{all:.4?}, weights {:?}", found.weights);
    assert!(all[2] < 0.3 * all[0] && all[3] < 0.8 * all[2] && all[5] < 0.8 * all[2], "{all:?}");
    assert!((0..6).all(|method| error(method, 0) < error(method, 2)), "long rollouts err more");
    let text: String = measured.tables.iter().map(|table| table.markdown()).collect();
    assert!(
        text.contains("calibrated, with its own zero:shoulder, zero:elbow")
            && text.contains("held near what all share"),
        "{text}"
    );
}

/// rapier has no dry friction: it is left out, and the other solvers go on.
#[test]
fn a_solver_that_cannot_is_left_out_and_the_others_go_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    let urdf = r#"<robot name="dry"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"
        ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><dynamics friction="0.05"/></joint></robot>"#;
    file("dry.urdf", urdf);
    let mut chart = Chart::default();
    (chart.robot, chart.trajectories, chart.frames, chart.max_substeps) =
        (folder.path().join("dry.urdf").display().to_string(), 1, 2, 4);
    chart.about().expect("a chart");
    let measured = chart.measure().expect("a chart");
    let series: Vec<_> = measured.tables[0].rows.iter().map(|row| row[0].clone()).collect();
    assert!(series.len() > 1 && series.iter().all(|s| s.starts_with("articulated")), "{series:?}");

    file(
        "dry.log.toml",
        "file = \"dry.csv\"\nrobot = \"dry.urdf\"\nscene = \"free\"\ntrajectory = \"n\"\ntime = \"t\"\n[[joint]]\nname = \"j\"\nposition = \"q\"\nvelocity = \"v\"\n",
    );
    let row = |n: usize, k: usize| {
        let (t, w) = (k as f64 / 60.0, 5.7f64);
        let (sin, cos) = (w * t).sin_cos();
        format!("{n},{t},{},{}\n", 0.01 * n as f64 * cos, -0.01 * n as f64 * w * sin)
    };
    file(
        "dry.csv",
        &(1..9).flat_map(|n| (0..12).map(move |k| row(n, k))).fold("n,t,q,v\n".into(), |all: String, row| all + &row),
    );
    let mut settings = Calibration::default();
    settings.log = vec![folder.path().join("dry.log.toml")];
    (settings.splits, settings.frames, settings.every, settings.evaluations, settings.rollouts) = (1, 6, 3, 40, 8);
    let found = settings.all().expect("a calibration");
    let solvers: Vec<_> = found.fitted.iter().map(|fitted| &fitted.solver[..]).collect();
    assert_eq!(solvers, ["articulated(substeps=4)"]);
    settings.solver = vec!["rapier".into()];
    let reason = refusal(settings.all());
    assert!(reason.contains("`j` has dry friction"), "{reason}");
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

fn policy(task: &str) -> (Shape, PpoConfig, Policy) {
    let (task, ppo) = (named(task).expect("registered"), PpoConfig::of(task).expect("settings"));
    let shape = Shape { hidden: vec![8], ..Shape::of(&*task, &ppo) };
    let policy = Policy::new(shape.clone(), &mut stream(1, 0));
    (shape, ppo, policy)
}

#[test]
fn the_truths_own_settings_judge_as_the_truth_does() {
    for task in ["ant-run", "cartpole-swingup"] {
        let (_, _, policy) = policy(task);
        let rewards = |arena: &Arena| {
            games(task, arena, &policy, 3, 5).expect("played").iter().map(|g| g.reward).collect::<Vec<_>>()
        };
        let truth = rewards(&Arena::Solver(SolverSpec::default()));
        assert_eq!(
            rewards(&Arena::Solver(SolverSpec::implicit(
                System::named(nerd_tasks::named(task).expect("a task").robot()).expect("built in").spec.substeps
            ))),
            truth,
            "{task}: preset accurate is the truth"
        );
        assert_ne!(rewards(&Arena::from(Truth::Paper)), truth, "{task}: the reference's preset is another judge");
    }
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

/// Two tasks, and two policies of one task in folders of the same name. Each policy has one column, with its terms
/// alone.
#[test]
fn terms_of_rewards_have_a_column_by_policy() {
    let row = |task: &str, policy: &str, term: f64| -> policies::Row {
        let reward = serde_json::json!({ "mean": 1.0, "spread": 0.0, "length": 1.0 });
        let row = serde_json::json!({ "task": task, "policy": policy, "trained_in": "-", "truth": "-", "model": null, "games": 1, "real": reward,
            "learned": null, "gap": null, "terms": [["pace", term]] });
        serde_json::from_value(row).expect("a row")
    };
    let rows = [
        row("walk-go2", "a/walk/policy", 1.0),
        row("walk-go2", "b/walk/policy", 2.0),
        row("rough-go2", "c/rough/policy", 3.0),
        row("walk-go2", "keeps still", 4.0),
        row("rough-go2", "keeps still", 5.0),
    ];
    let table = policies::terms(&rows).expect("terms");
    assert_eq!(table.header, ["task", "term", "a/walk/policy", "b/walk/policy", "rough", "keeps still"]);
    assert_eq!(
        table.rows,
        [["walk-go2", "pace", "1.000", "2.000", "-", "4.000"], ["rough-go2", "pace", "-", "-", "3.000", "5.000"]],
        "cells"
    );
}

#[test]
fn json_has_numbers_where_a_column_holds_nothing_else() {
    let header = ["name", "label", "error", "games", "verdict", "none"];
    let rows = [
        ["1e5", "007", "1.50 ± 0.5 / 2", "3", "1.00", "-"],
        ["nan", "nan", "-", "1.5e-3", "under 0.01", "-"],
        ["12", "8", "NaN +- 0.5", "-0.25", "2", "-"],
    ];
    let table = Table::new("some", &header).with(rows.map(|row| row.map(String::from).to_vec()));
    let rows = serde_json::json!([
        { "name": "1e5", "label": "007", "error": [1.5, 0.5, 2.0], "games": 3.0, "verdict": "1.00", "none": null },
        { "name": "nan", "label": "nan", "error": null, "games": 0.0015, "verdict": "under 0.01", "none": null },
        { "name": "12", "label": "8", "error": [null, 0.5], "games": -0.25, "verdict": "2", "none": null },
    ]);
    assert_eq!(table.json(), rows);
}

/// On robots of a family a policy counts as fallen if an episode ends early, and no model plays.
#[test]
fn a_policy_is_played_on_robots_of_a_family() {
    let policy = format!("policy={}/../models/policies/ant-run-articulated-0", env!("CARGO_MANIFEST_DIR"));
    let measured = settings::<policies::Policies>(&[&policy, "episodes=4", "family=ant-family"])
        .and_then(|e| e.measure())
        .expect("measured");
    let (row, header) = (&measured.tables[0].rows[0], &measured.tables[0].header);
    let cell = |name: &str| header.iter().position(|h| h == name).map_or("", |k| &row[k]);
    assert!(cell("robots") == "articulated of ant-family" && cell("in NeRD") == "-", "{row:?}");
    let (fell, length) =
        (cell("fell (%)").parse::<f64>().expect("a share"), &measured.data["rows"][0]["real"]["length"]);
    assert_eq!(fell == 0.0, length.as_f64() == Some(500.0), "{fell} % fell, {length} steps");
    for (set, why) in [
        (&["family=pendulum-family"][..], "no family of `ant`"),
        (&["family=ant-family", "fresh-seeds=7"], "policy train --family"),
    ] {
        let all = [&[&policy[..], "episodes=2"], set].concat();
        let said =
            settings::<policies::Policies>(&all).and_then(|e| e.about().map(|_| ())).expect_err("refused").to_string();
        assert!(said.contains(why), "{set:?}: {said}");
    }
}

/// The scene of such a task is not one of its robot's scenes.
#[test]
fn games_on_a_terrain_of_a_task_say_what_they_depend_on() {
    let mut inputs = Inputs::default();
    nerd_lab::experiments::games::depend(&mut inputs, "rough@anymal", Truth::Articulated).expect("inputs");
    assert_eq!(inputs.0.len(), 2, "a robot and a motion: {inputs:?}");
}
