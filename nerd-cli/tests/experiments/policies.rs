//! Policies played on solvers, models and robots of a family, and the terms of their rewards.

use nerd_cli::experiments::games::{depend, games};
use nerd_cli::experiments::{Experiment, policies};
use nerd_cli::report::Inputs;
use nerd_sim::prelude::*;
use nerd_tasks::named;
use nerd_train::ppo::{Arena, Policy, PpoConfig, Shape};
use nerd_train::spec::SolverSpec;

use super::common::settings;

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
                System::named(named(task).expect("a task").robot()).expect("built in").spec.substeps
            ))),
            truth,
            "{task}: preset accurate is the truth"
        );
        assert_ne!(rewards(&Arena::from(Truth::Paper)), truth, "{task}: the reference's preset is another judge");
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
    depend(&mut inputs, "rough@anymal", Truth::Articulated).expect("inputs");
    assert_eq!(inputs.0.len(), 2, "a robot and a motion: {inputs:?}");
}
