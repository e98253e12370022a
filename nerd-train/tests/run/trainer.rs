//! A run reports a rising validation loss while it trains, and ignores noise.

use nerd_train::trainer::Trainer;

use crate::*;

/// Learns nothing; `losses` are its validation losses.
struct Told {
    state: LearnerState,
    losses: Vec<f32>,
}

impl Learner for Told {
    fn update(&mut self, _lr: f32) -> Result<(), LearnError> {
        self.state.step += 1;
        Ok(())
    }

    fn progress(&mut self) -> Result<Progress, LearnError> {
        Ok(Progress::default())
    }

    fn validate(&mut self, _windows: usize) -> Result<f32, LearnError> {
        Ok(self.losses[self.state.step as usize - 1])
    }

    fn state(&mut self) -> Result<LearnerState, LearnError> {
        Ok(self.state.clone())
    }
}

/// A run's reports of a risen loss, as (step, validations since the least). The run is stopped at `stop` and continued.
fn told(losses: &[f32], stop: usize) -> Vec<(u64, u64)> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (first, last) in [(0, stop), (stop, losses.len())] {
        let (updates, schedule) = (last as u64, Schedule { start: 1e-3, end: 1e-4, warmup: 0 });
        let config = TrainerConfig {
            updates,
            schedule,
            validate_every: 1,
            checkpoint_every: 0,
            validation_windows: 51_200,
            log_every: 500,
        };
        let mut learner = Told { state: LearnerState { step: first as u64, ..fresh() }, losses: losses.to_vec() };
        Trainer::new(config, 1, folder.path(), "{}").run(&mut learner, None, &mut |_, _| Ok(None)).expect("a run");
    }
    let text = std::fs::read_to_string(folder.path().join("metrics.jsonl")).expect("a record");
    let lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
    lines.filter_map(|line| Some((line["step"].as_u64()?, line["risen"].as_u64()?))).collect()
}

#[test]
fn a_validation_loss_that_rises_is_said_while_it_rises_and_noise_is_not() {
    let overfits = [1.0, 0.5, 0.6, 0.7, 0.8, 0.75, 0.9, 0.4, 0.41];
    for stop in [1, 3, 6] {
        assert_eq!(told(&overfits, stop), [(5, 3), (7, 5)], "left at {stop}: (step, validations since the least)");
    }
    assert_eq!(told(&[1.0, 0.5, 0.505, 0.501, 0.503, 0.504, 0.508], 2), [], "noise of a plateau");
}
