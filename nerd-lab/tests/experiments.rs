//! Experiments: what they refuse, what they say, and what they never overwrite.

use nerd_lab::choice::Choice;
use nerd_lab::experiments::passive::{Case, Passive, Row, Rows};
use nerd_lab::experiments::substeps::Substeps;
use nerd_lab::experiments::{Experiment, conduct};
use nerd_lab::report::Artifact;
use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use nerd_sim::truth::Truth;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport};

fn truth() -> Case {
    let (solver, scenes) = (Choice::Setting(Setting::Accurate), vec!["ground1".into()]);
    Case { solver, scenes, starts: 2, steps: Some(4), ..Case::default() }
}

#[test]
fn the_truth_against_itself_is_zero_and_refused_unless_asked_for_by_name() {
    let said = Passive::new("p", 1, &[truth()]).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("against itself") && !said.contains('\n'), "{said}");
    let rows = Passive::new("p", 1, &[Case { control: true, ..truth() }]).and_then(|p| p.measure()).expect("measured").rows;
    assert_eq!((rows.len(), &rows[0].report.error), (1, &vec![0.0, 0.0]));
    let other = Case { solver: Choice::Rapier(RapierConfig::default()), control: true, ..truth() };
    let said = Passive::new("p", 1, &[other]).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("--control"), "{said}");
}

#[test]
fn a_result_gives_way_to_none_with_less_behind_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shaken = |starts| Passive::new("shaken", 1, &[Case { shake: 0.01, starts, ..truth() }]).expect("asked");
    let written = conduct(&shaken(3), folder.path()).expect("written");
    assert_eq!((written.effort, written.data.rows.len()), (12.0, 1));
    let said = conduct(&shaken(2), folder.path()).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("shaken.json") && said.contains("--out"), "{said}");
    conduct(&shaken(3), folder.path()).expect("as much is enough");
    let read: Artifact<Rows> = Artifact::read(folder.path(), "shaken").expect("read");
    let [found, measured] = [&read, &written].map(|result| result.data.rows[0].report.error[0]);
    assert!((found / measured - 1.0).abs() < 1e-14, "{found} in the file, {measured} measured");
    assert_eq!(read.inputs.changed(), Vec::<String>::new(), "nothing has changed since");
}

#[test]
fn the_summary_names_the_largest_of_a_robots_grounds() {
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
            glide: vec![1.0; 2],
            curve: vec![error],
            diverged: 0,
            first_divergence: None,
            failed: 0,
        },
        paper: None,
    };
    let rows = Rows { rows: vec![row("free", 0.5), row("ground1", 0.1), row("ground2", 0.3), row("ground3", 0.2)] };
    let scenes: Vec<_> = rows.summary().rows.into_iter().map(|r| r[1].clone()).collect();
    assert_eq!(scenes, ["free", "ground2, the largest of 3"]);
    assert!(rows.agreement(&rows).is_some_and(|said| said.starts_with("4 of 4") && said.contains("farthest 0.0")));
    let other = Rows { rows: vec![row("free", 0.5), row("ground2", 0.4), row("ground9", 0.1)] };
    assert!(rows.agreement(&other).is_some_and(|said| said.starts_with("1 of 2") && said.contains("pendulum in ground2")));
    assert_eq!(rows.agreement(&Rows { rows: vec![row("ground9", 0.1)] }), None);
}

#[test]
fn a_choice_knows_its_setting_and_whether_it_is_the_truth() {
    let system = System::named("pendulum").expect("built in");
    let (law, ground) = (Friction::Coulomb, system.scene("ground1").expect("scene"));
    for (choice, setting, words) in [
        (Choice::Articulated(ArticulatedConfig::accurate(&system)), Some(Setting::Accurate), "articulated accurate"),
        (Choice::Articulated(ArticulatedConfig::implicit(8, law)), Some(Setting::Accurate), "articulated accurate"),
        (Choice::Articulated(ArticulatedConfig::paper(&system, law)), Some(Setting::Paper), "articulated paper"),
        (Choice::Articulated(ArticulatedConfig::converged(law)), Some(Setting::Implicit(128)), "articulated implicit x128"),
        (Choice::Articulated(ArticulatedConfig::converged(Friction::Huber)), None, "articulated x128, huber friction"),
        (Choice::Rapier(Truth::rapier()), Some(Setting::RapierSteps(16)), "rapier 16x4"),
        (Choice::Rapier(RapierConfig::substeps(8)), Some(Setting::Rapier(8)), "rapier 1x8"),
    ] {
        assert_eq!(choice.setting(&system), setting, "{choice:?}");
        assert_eq!(choice.title(&system).expect("no model"), words);
        let truths: Vec<_> = Truth::ALL.iter().filter(|t| choice.is(**t, &system, &ground)).collect();
        let known = ["articulated accurate", "articulated paper", "rapier 16x4"].contains(&words);
        assert_eq!(truths.len(), usize::from(known), "{words}");
    }
    // Eight substeps everywhere: on a ground that is the truth, in empty space it is not.
    let eight = Choice::Articulated(ArticulatedConfig { substeps: 8, ..ArticulatedConfig::accurate(&system) });
    let free = system.scene("free").expect("scene");
    assert_eq!([&ground, &free].map(|scene| eight.is(Truth::Articulated, &system, scene)), [true, false], "eight substeps");
}

/// More substeps come nearer to a converged motion, and what shakes a start twice as much drives it twice as far.
#[test]
fn substeps_converge_and_a_shaken_start_has_its_size() {
    let measured = |shake: f64| {
        let mut asked = Substeps::default();
        (asked.robot, asked.starts, asked.frames) = (vec!["cartpole".into(), "cube".into()], 4, 20);
        (asked.shake, asked.no_games) = (shake, true);
        let data = asked.measure().expect("measured");
        assert_eq!(asked.tables(&data).expect("tables").len(), 2, "no games, no table of them");
        data.rollouts
    };
    let (rows, more) = (measured(1e-6), measured(2e-6));
    assert_eq!(rows.len(), 3, "Cartpole passive and driven, the cube passive");
    for (row, more) in rows.iter().zip(&more) {
        let errors: Vec<f64> = row.ladder.iter().map(|l| l.1).collect();
        assert!(errors[4] < 0.5 * errors[0], "{} {}: {errors:?}", row.robot, row.drive());
        assert_eq!(row.ladder[2].0, row.substeps);
        let ratio = more.shaken.mean() / row.shaken.mean();
        assert!((ratio - 2.0).abs() < 0.2, "{} {}: twice the noise drives it {ratio} times as far", row.robot, row.drive());
    }
}
