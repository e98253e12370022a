//! Records, schedule, bounds of settings, and draws of windows.

use nerd_train::records::Record;
use nerd_train::windows::draw;

use crate::*;

#[test]
fn a_reopened_record_drops_what_will_be_written_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metrics.jsonl");
    let line = |step: u64| serde_json::json!({ "kind": "validation", "step": step, "criterion": 1.0 });
    let mut metrics = Record::metrics(folder.path(), 0).unwrap();
    (1..=5).for_each(|step| metrics.write(&line(step)).unwrap());
    drop(metrics);
    std::fs::write(&path, std::fs::read_to_string(&path).unwrap() + "{\"kind\":\"tra").unwrap();
    Record::metrics(folder.path(), 3).unwrap().write(&line(4)).unwrap();
    let steps: Vec<u64> = std::fs::read_to_string(&path)
        .unwrap()
        .lines()
        .map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap()["step"].as_u64().unwrap())
        .collect();
    assert_eq!(steps, [1, 2, 3, 4]);
}

#[test]
fn schedule_values() {
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
    let paper = Schedule { start: 1e-3, end: 1e-4, warmup: 0 };
    close(paper.rate(0, 1000), 1e-3);
    close(paper.rate(500, 1000), 5.5e-4);
    close(paper.rate(999, 1000), 1.009e-4);
    let warm = Schedule { warmup: 10, ..paper };
    close(warm.rate(0, 1000), 1e-4);
    close(warm.rate(500, 1000), 5.5e-4);
    close(warm.rate(2000, 1000), 1e-4);
}

#[test]
fn settings_out_of_their_ranges_are_refused_by_name() {
    let trainer = crate::resume::CONFIG;
    let schedule =
        |start: f64, end: f64| TrainerConfig { schedule: Schedule { start, end, ..trainer.schedule }, ..trainer };
    [trainer.check(), schedule(1e-3, 0.0).check(), LEARNER.check()].into_iter().for_each(|usual| usual.expect("usual"));
    for (refused, words) in [
        (TrainerConfig { updates: 0, ..trainer }.check(), "updates is 0"),
        (TrainerConfig { updates: u64::MAX, ..trainer }.check(), "updates"),
        (TrainerConfig { validation_windows: 0, ..trainer }.check(), "validation_windows"),
        (schedule(-1.0, 0.0).check(), "rate is -1"),
        (schedule(0.0, 0.0).check(), "rate is 0"),
        (schedule(f64::NAN, 0.0).check(), "rate is NaN"),
        (schedule(f64::INFINITY, 0.0).check(), "rate is inf"),
        (schedule(1e-3, -1e-9).check(), "last_rate"),
        (LearnerConfig { batch: 0, ..LEARNER }.check(), "batch is 0"),
        (LearnerConfig { batch: usize::MAX, ..LEARNER }.check(), "batch"),
        (LearnerConfig { average: 1.0, ..LEARNER }.check(), "average is 1"),
        (LearnerConfig { average: f64::NAN, ..LEARNER }.check(), "average"),
        (LearnerConfig { clip: 0.0, ..LEARNER }.check(), "clip"),
        (LearnerConfig { huber: Some(f32::NAN), ..LEARNER }.check(), "huber"),
        (LearnerConfig { huber: Some(0.0), ..LEARNER }.check(), "huber"),
    ] {
        let error = refused.expect_err(words);
        assert!(error.contains(words), "{error} does not say {words}");
    }
}

/// Chi-square over 91 windows and 512 x 400 draws: mean 90, standard deviation 13.4.
#[test]
fn draws_are_uniform_and_a_function_of_seed_step_and_row() {
    let mut counts = [0u32; 91];
    (0..400).for_each(|step| (0..512).for_each(|row| counts[draw(1, step, row, 91) as usize] += 1));
    let expected = 400.0 * 512.0 / 91.0;
    let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
    assert!((40.0..150.0).contains(&chi2), "chi-square {chi2:.1} of 90 degrees of freedom");
    assert_eq!(draw(1, 2, 3, 1000), draw(1, 2, 3, 1000));
    let same = (0..1000).filter(|&row| draw(1, 2, row, 1000) == draw(2, 2, row, 1000)).count();
    assert!(same < 10, "{same} of 1000 rows equal under another seed");
}
