//! Judges: the truth's own settings judge as the truth does, the reference's preset acts on the reference's robot, and every
//! judge is named in the table. A judge that is not there is refused in one line.

use std::path::{Path, PathBuf};

use nerd_lab::experiments::Experiment;
use nerd_lab::experiments::games::games;
use nerd_lab::experiments::judges::{Judges, mujoco};
use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use nerd_sim::sampling::stream;
use nerd_tasks::named;
use nerd_train::ppo::folder::{PolicyConfig, save};
use nerd_train::ppo::{Arena, Policy, PpoConfig, Shape};

/// A policy of random weights.
fn policy(task: &str) -> (Shape, PpoConfig, Policy) {
    let (task, ppo) = (named(task).expect("registered"), PpoConfig::of(task).expect("settings"));
    let shape = Shape {
        observation: task.observation_dim(),
        stack: ppo.stack,
        action: task.action_dim(),
        hidden: vec![8],
        activation: ppo.activation,
        spread_by_state: ppo.spread_by_state,
    };
    let policy = Policy::new(shape.clone(), &mut stream(1, 0));
    (shape, ppo, policy)
}

#[test]
fn the_truths_own_settings_judge_as_the_truth_does() {
    for task in ["ant-run", "cartpole-swingup"] {
        let (_, _, policy) = policy(task);
        let rewards = |arena: &Arena| games(task, arena, &policy, 3, 5).expect("played").iter().map(|g| g.reward).collect::<Vec<_>>();
        let system = System::named(named(task).expect("registered").robot()).expect("built in");
        let truth = rewards(&Arena::Truth(Truth::Articulated));
        assert_eq!(rewards(&Arena::Judge(Setting::Accurate)), truth, "{task}: preset accurate is the truth");
        assert_eq!(rewards(&Arena::Judge(Setting::Implicit(system.spec.substeps))), truth, "{task}: so are its substeps");
        let other = rewards(&Arena::Judge(Setting::Paper));
        assert_ne!(other, truth, "{task}: the reference's preset is another judge");
        assert_eq!(rewards(&Arena::Judge(Setting::from(Truth::Rapier))), rewards(&Arena::Truth(Truth::Rapier)), "{task}: rapier");
    }
}

#[test]
fn the_references_preset_acts_on_the_references_robot() {
    for task in ["ant-run", "anymal-side", "franka-reach"] {
        let robot = |arena: Arena| arena.episodes(task, 1, 0).expect("made").simulation.batch.system.name.clone();
        let own = named(task).expect("registered").robot();
        assert_eq!(robot(Arena::Judge(Setting::Paper)), format!("{own}-paper"));
        assert_eq!(robot(Arena::Judge(Setting::Implicit(16))), own);
        assert_eq!(robot(Arena::Truth(Truth::Articulated)), own);
    }
}

#[test]
fn a_judge_that_is_not_there_is_refused_in_one_line() {
    let refused = |python: &str, word: &str| {
        let error = mujoco(python.into()).episodes("cartpole-swingup", 1, 0).err().expect("no MuJoCo").to_string();
        assert!(error.contains(word) && !error.contains('\n'), "`{error}` is not one line that names {word}");
    };
    refused("/nowhere/python", "/nowhere/python");
    // A program that is no Python: it ends and says nothing.
    if Path::new("/bin/true").exists() {
        refused("/bin/true", "MuJoCo");
    }
}

#[test]
fn every_judge_has_a_column_and_every_policy_a_row() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    for (name, task) in [("swing", "cartpole-swingup"), ("reach", "franka-reach")] {
        let (shape, ppo, policy) = policy(task);
        let solver = Truth::Articulated.name();
        let config = PolicyConfig { task: task.into(), solver, shape, ppo, iterations: 1, reward: None, provenance: Default::default() };
        save(&at(name), &config, &policy, "# A card\n").expect("written");
    }
    let mut judges = Judges::default();
    (judges.policy, judges.games, judges.substeps, judges.no_rapier) = (vec![at("swing"), at("reach")], 2, vec![3], true);
    let judged = judges.measure().expect("played");
    let names: Vec<Vec<&str>> = judged.rows.iter().map(|r| r.judged.iter().map(|(name, _)| name.as_str()).collect()).collect();
    assert_eq!(names, [["truth", "twice the substeps", "x3", "reference preset"]; 2]);
    for row in &judged.rows {
        assert!(row.judged.iter().all(|(_, r)| r.mean.is_finite() && r.length > 0.0), "{row:?}");
        // Nothing is touched, so RK4 at eight substeps goes where RK4 at four does.
        let [truth, finer] = [0, 1].map(|k| row.judged[k].1.mean);
        assert!((finer - truth).abs() < 0.02 * truth.abs(), "{}: {finer} at twice the substeps, {truth} in the truth", row.task);
    }
    let table = &judges.tables(&judged).expect("tables")[0];
    assert_eq!((table.rows.len(), table.header.len()), (2, 6), "{table:?}");
    judges.mujoco = Some("/nowhere/python".into());
    let said = judges.measure().err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("/nowhere/python") && !said.contains('\n'), "{said}");
}
