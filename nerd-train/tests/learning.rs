//! Gradients and optimisation of the burn learner.

mod common;

use common::{LEARNER, fresh, learner, windows};
use nerd_train::learner::{BurnLearner, LearnError, Learner, LearnerConfig, LearnerState};

/// Central differences along the gradient itself and two other directions, f32 losses: measured below 0.3 %.
#[test]
fn gradient_is_the_slope_of_the_loss() {
    let rows: Vec<u64> = (0..24).map(|i| i * 11).collect();
    let state = fresh();
    let (_, gradient) = learner(state.clone()).gradient(&rows).unwrap();
    let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
    let along: Vec<f32> = gradient.iter().map(|g| g / norm).collect();
    let mixed = |k: usize| along.iter().enumerate().map(|(i, a)| if i % k == 0 { 1.5 * a } else { 0.3 * a }).collect::<Vec<f32>>();
    for direction in [along.clone(), mixed(2), mixed(3)] {
        let loss = |h: f32| {
            let mut moved = state.clone();
            moved.weights.flat.iter_mut().zip(&direction).for_each(|(w, d)| *w += h * d);
            f64::from(learner(moved).gradient(&rows).unwrap().0)
        };
        let slope = (loss(0.01) - loss(-0.01)) / 0.02;
        let expected: f64 = gradient.iter().zip(&direction).map(|(g, d)| f64::from(g * d)).sum();
        assert!((slope / expected - 1.0).abs() < 0.01, "finite difference {slope:.6}, gradient {expected:.6}");
    }
}

#[test]
fn gradient_does_not_depend_on_threads_and_hardly_on_shards() {
    let rows: Vec<u64> = (0..24).collect();
    let of = |shard, threads| learner(fresh()).shards(shard, threads).gradient(&rows).unwrap().1;
    assert_eq!(of(5, 1), of(5, 3));
    let (whole, cut) = (of(24, 1), of(5, 2));
    let scale = whole.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    let worst = whole.iter().zip(&cut).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-5 * scale, "differ by {worst:.1e} of {scale:.1e}");
}

#[test]
fn a_linear_map_is_learnt() {
    let mut learner = learner(fresh());
    let before = learner.validate(1000).unwrap();
    for _ in 0..600 {
        learner.update(3e-3).unwrap();
    }
    let after = learner.validate(1000).unwrap();
    let progress = learner.progress().unwrap();
    assert!(after < before / 20.0, "validation loss {before:.3} -> {after:.4}");
    assert!(progress.loss.is_finite() && progress.gradient_norm > 0.0);
    assert_eq!(learner.progress().unwrap().loss, 0.0, "asked twice, the second mean is over nothing");
}

#[test]
fn a_loss_that_is_no_number_names_its_update() {
    let mut learner = learner(fresh());
    learner.update(1e30).unwrap();
    let weights = learner.state().unwrap();
    let error = learner.update(1e30).unwrap_err();
    assert!(error.to_string().contains("update 1"), "{error}");
    assert_eq!(learner.state().unwrap().step, weights.step);
}

#[test]
fn windows_that_do_not_fit_are_refused() {
    let wide = std::sync::Arc::new(nerd_train::windows::Windows { history: 5, ..(*windows(0.0)).clone() });
    let made = |config, train| BurnLearner::new(config, fresh(), train, windows(0.5), &nerd_model::BurnDevice::flex()).err();
    assert!(matches!(made(LEARNER, wide), Some(LearnError::Mismatch(m)) if m.contains("(3, 2, 5)")));
    assert!(matches!(made(LearnerConfig { batch: 0, ..LEARNER }, windows(0.0)), Some(LearnError::Mismatch(_))));
    let short = LearnerState { m: vec![0.0; 3], ..fresh() };
    assert!(BurnLearner::new(LEARNER, short, windows(0.0), windows(0.5), &nerd_model::BurnDevice::flex()).is_err());
}

/// First Adam update from zero moments moves every weight by lr against its gradient's sign; the average follows.
#[test]
fn the_first_update_is_adams() {
    let mut learner = learner(fresh());
    learner.update(1e-3).unwrap();
    let (before, after) = (fresh(), learner.state().unwrap());
    let moved: Vec<f32> = after.weights.flat.iter().zip(&before.weights.flat).map(|(a, b)| (a - b).abs()).collect();
    let full = moved.iter().filter(|&&d| (d - 1e-3).abs() < 2e-5).count();
    assert!(full as f64 > 0.9 * moved.len() as f64, "{full} of {} weights moved by lr", moved.len());
    assert!(moved.iter().all(|&d| d < 1.01e-3));
    // d = min(0.99, 1 / 10).
    let expected = after.weights.flat.iter().zip(&before.weights.flat).map(|(a, b)| a + 0.1 * (b - a));
    assert!(after.average.iter().zip(expected).all(|(a, e)| (a - e).abs() < 1e-7));
}
