//! A run that is stopped and continued is the unbroken run, bit for bit.

use std::time::Duration;

use nerd_train::checkpoint;
use nerd_train::error::Error;
use nerd_train::trainer::{Outcome, Trainer};

use crate::*;

pub const CONFIG: TrainerConfig = TrainerConfig {
    updates: 30,
    schedule: Schedule { start: 1e-3, end: 1e-4, warmup: 3 },
    validate_every: 6,
    checkpoint_every: 7,
    validation_windows: 50,
    log_every: 1,
};

fn train(folder: &Path, state: LearnerState, wall: Option<Duration>) -> (Outcome, LearnerState) {
    let mut learner = learner(state);
    let mut trainer = Trainer::new(CONFIG, LEARNER.batch, folder, "{\"name\":\"test\"}");
    trainer.stop_at = wall;
    let outcome = trainer.run(&mut learner, None, &mut |_, _| Ok(None)).unwrap();
    (outcome, learner.state().unwrap())
}

fn load(folder: &Path) -> LearnerState {
    let (state, config) = checkpoint::load(&folder.join("last.safetensors"), &NETWORK).unwrap();
    assert_eq!(config, "{\"name\":\"test\"}");
    state
}

/// The record without windows per second, which differ from run to run.
fn record(folder: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(folder.join("metrics.jsonl")).unwrap();
    let line = |l: &str| {
        let mut value: serde_json::Value = serde_json::from_str(l).unwrap();
        value.as_object_mut().unwrap().remove("windows_per_second");
        value
    };
    text.lines().map(line).collect()
}

#[test]
fn stopped_at_every_update_and_continued() {
    let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (outcome, end) = train(whole.path(), fresh(), None);
    assert_eq!((outcome.step, outcome.finished), (30, true));
    let mut state = fresh();
    for step in 1..=30 {
        // With no time at all a run makes one update, writes a checkpoint and returns.
        let (outcome, _) = train(parts.path(), state, Some(Duration::ZERO));
        assert_eq!((outcome.step, outcome.finished), (step, step == 30));
        state = load(parts.path());
    }
    assert!(state == end, "the states differ");
    assert_eq!(record(parts.path()), record(whole.path()));
    assert_eq!(record(whole.path()).len(), 30 + 5);
    let best =
        |folder: &Path| Weights::from_bytes(NETWORK, &std::fs::read(folder.join("best.safetensors")).unwrap()).unwrap();
    assert!(best(parts.path()) == best(whole.path()), "the best weights differ");
}

#[test]
fn the_hooks_value_chooses_the_best_weights() {
    let folder = tempfile::tempdir().unwrap();
    let trainer = Trainer::new(CONFIG, LEARNER.batch, folder.path(), "{}");
    let mut at_twelve = None;
    let mut hook = |learner: &mut dyn Learner, step: u64| {
        if step == 12 {
            at_twelve = Some(learner.state()?.average);
        }
        Ok(Some(if step == 18 { f64::NAN } else { (step as f64 - 12.0).abs() }))
    };
    let outcome = trainer.run(&mut learner(fresh()), None, &mut hook).unwrap();
    assert_eq!(outcome.best, Some((12, 0.0)));
    let bytes = std::fs::read(folder.path().join("best.safetensors")).unwrap();
    assert!(
        Some(Weights::from_bytes(NETWORK, &bytes).unwrap().flat) == at_twelve,
        "other weights than those of step 12"
    );
}

#[test]
fn killed_between_checkpoints() {
    let (whole, killed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (_, end) = train(whole.path(), fresh(), None);
    // The hook fails at step 18: the last checkpoint is of step 14, the record goes on to 18.
    let trainer = Trainer::new(CONFIG, LEARNER.batch, killed.path(), "{\"name\":\"test\"}");
    let mut hook = |_: &mut dyn Learner, step: u64| {
        if step == 18 { Err(Error::Refused("power cut at 18".into())) } else { Ok(None) }
    };
    let error = trainer.run(&mut learner(fresh()), None, &mut hook).unwrap_err();
    assert!(error.to_string().contains("power cut at 18"), "{error}");
    let state = load(killed.path());
    assert_eq!(state.step, 14);
    let (_, resumed) = train(killed.path(), state, None);
    assert!(resumed == end, "the states differ");
    assert_eq!(record(killed.path()), record(whole.path()));
}
