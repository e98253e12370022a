//! Experiments of the users' verbs on the smallest settings: measurements, refusals, and results on disk.

use nerd_cli::experiments::conduct;
use nerd_cli::experiments::passive::{Passive, Row, Rows};
use nerd_cli::report::{Artifact, Table};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport};

mod calibrated;
#[path = "../common/mod.rs"]
mod common;
#[path = "../../../nerd-model/tests/common/mod.rs"]
mod models;
mod policies;

use common::truth;

/// The one-line message of a refusal.
fn refusal<T>(done: anyhow::Result<T>) -> String {
    let words = done.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(!words.is_empty() && !words.contains('\n'), "`{words}` is not one line");
    words
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
