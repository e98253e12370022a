//! Orthogonalised momentum and the moving average.

mod common;

use common::{LEARNER, NETWORK, fresh};
use nalgebra::DMatrix;
use nerd_train::learner::muon::{hidden, orthogonal, others};
use nerd_train::learner::{LearnerConfig, Optimizer, adam, blend};

/// `U diag(s) V^T` becomes `U diag(about 1) V^T`, whatever s was.
#[test]
fn orthogonalisation_keeps_the_directions_and_levels_the_strengths() {
    let wave = |rows, columns, k: f32| DMatrix::from_fn(rows, columns, |r, c| (k * (r * columns + c) as f32 + 0.3).sin());
    let (u, v) = (wave(16, 16, 1.7).qr().q(), wave(64, 16, 2.3).qr().q());
    let strengths = DMatrix::from_fn(16, 16, |r, c| if r == c { 10f32.powf(-(r as f32) / 8.0) } else { 0.0 });
    let levelled = u.transpose() * orthogonal(&u * strengths * v.transpose()) * v;
    for r in 0..16 {
        for c in 0..16 {
            let x = levelled[(r, c)];
            let fits = if r == c { (0.65..1.25).contains(&x) } else { x.abs() < 1e-4 };
            assert!(fits, "entry ({r}, {c}) is {x:.5}");
        }
    }
}

#[test]
fn every_weight_belongs_to_one_of_the_two_optimisers() {
    let mut owners = vec![0; NETWORK.parameters()];
    let matrices = hidden(&NETWORK).concat();
    matrices.iter().for_each(|h| (0..h.rows).for_each(|r| (0..h.columns).for_each(|c| owners[h.at(r, c)] += 1)));
    others(&NETWORK).into_iter().flatten().for_each(|i| owners[i] += 1);
    assert_eq!(owners.iter().position(|&n| n != 1), None, "a weight that not exactly one optimiser updates");
}

/// The root mean square of a Muon update is a fifth of the learning rate, Adam's first one is the learning rate.
#[test]
fn updates_have_the_size_that_one_learning_rate_serves() {
    let (before, mut after) = (fresh(), fresh());
    let gradient: Vec<f32> = (0..NETWORK.parameters()).map(|i| ((i * i) as f64 * 0.37).sin() as f32 * 1e-3).collect();
    let config = LearnerConfig { optimizer: Optimizer::Muon, ..LEARNER };
    adam::step(&mut after, &gradient, adam::norm(&gradient), 1e-2, &config);
    let moved = |i: usize| f64::from(after.weights.flat[i] - before.weights.flat[i]);
    for h in hidden(&NETWORK).concat() {
        let squares: f64 = (0..h.rows).flat_map(|r| (0..h.columns).map(move |c| h.at(r, c))).map(|i| moved(i).powi(2)).sum();
        let rms = (squares / (h.rows * h.columns) as f64).sqrt();
        assert!((1.4e-3..2.4e-3).contains(&rms), "a hidden matrix moved by {rms:.2e}, expected about 2e-3");
    }
    for i in others(&NETWORK).into_iter().flatten().filter(|&i| gradient[i].abs() > 1e-6) {
        assert!((moved(i).abs() - 1e-2).abs() < 2e-4, "weight {i} moved by {:.2e}, expected 1e-2", moved(i));
    }
}

/// In f32 the usual recursion at 0.9999 stops where `1e-4 |w - a|` is under half a unit in the last place, 3e-4 away.
#[test]
fn the_average_arrives_at_weights_that_stand_still() {
    let (mut average, mut naive) = (0.0f32, 0.0f32);
    for step in 0..400_000 {
        average += blend(0.9999, step) * (1.0 - average);
        naive += 1e-4 * (1.0 - naive);
    }
    let (here, there) = ((1.0 - average).abs(), (1.0 - naive).abs());
    assert!(here < 5e-5, "the average stops {here:.1e} away");
    assert!(there > 2e-4, "the naive one stops {there:.1e} away: this test shows nothing");
}
