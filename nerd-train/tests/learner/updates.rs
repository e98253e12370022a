//! Updates of every network: gradients, Adam, Muon, the moving average, and that a linear map is learned.

use nalgebra::DMatrix;
use nerd_train::learner::muon::{hidden, orthogonal, others};
use nerd_train::learner::optimiser::{self, blend};

use crate::*;

/// With attention and without.
fn networks() -> [TransformerConfig; 2] {
    [NETWORK, TransformerConfig { architecture: Architecture::Residual, layers: 2, ..NETWORK }]
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
    for (network, optimizer) in
        networks().into_iter().flat_map(|network| [(network, Optimizer::Adam), (network, Optimizer::Muon)])
    {
        let config = LearnerConfig { optimizer, ..LEARNER };
        let mut learner =
            CpuLearner::new(config, LearnerState::new(Weights::init(network, 3)), [windows(0.0), windows(0.5)])
                .expect("windows fit");
        let before = learner.validate(1000).unwrap();
        (0..600).for_each(|_| learner.update(3e-3).expect("finite"));
        let (after, progress) = (learner.validate(1000).unwrap(), learner.progress().unwrap());
        let of = network.architecture;
        assert!(after < before / 20.0, "{of:?}, {optimizer:?}: validation loss {before:.3} -> {after:.4}");
        assert!(progress.loss.is_finite() && progress.gradient_norm > 0.0);
        assert_eq!(learner.progress().unwrap().loss, 0.0, "asked twice, the second mean is over nothing");
    }
}

#[test]
fn windows_that_do_not_fit_are_refused() {
    let wide = Arc::new(Windows { history: 5, ..(*windows(0.0)).clone() });
    let made = |config, state, train| CpuLearner::new(config, state, [train, windows(0.5)]).err();
    assert!(matches!(made(LEARNER, fresh(), wide), Some(LearnError::Mismatch(m)) if m.contains("(3, 2, 5)")));
    assert!(matches!(
        made(LearnerConfig { batch: 0, ..LEARNER }, fresh(), windows(0.0)),
        Some(LearnError::Mismatch(_))
    ));
    assert!(made(LEARNER, LearnerState { m: vec![0.0; 3], ..fresh() }, windows(0.0)).is_some());
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
    // The average's decay is d = min(0.99, 1 / 10).
    let expected = after.weights.flat.iter().zip(&before.weights.flat).map(|(a, b)| a + 0.1 * (b - a));
    assert!(after.average.iter().zip(expected).all(|(a, e)| (a - e).abs() < 1e-7));
}

/// `U diag(s) V^T` becomes `U diag(about 1) V^T`, for any singular values s.
#[test]
fn orthogonalisation_keeps_the_directions_and_levels_the_strengths() {
    let wave =
        |rows, columns, k: f32| DMatrix::from_fn(rows, columns, |r, c| (k * (r * columns + c) as f32 + 0.3).sin());
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
    for network in networks() {
        let (of, mut owners) = (network.architecture, vec![0; network.parameters()]);
        let matrices = hidden(&network).concat();
        matrices.iter().for_each(|h| (0..h.rows).for_each(|r| (0..h.columns).for_each(|c| owners[h.at(r, c)] += 1)));
        others(&network).into_iter().flatten().for_each(|i| owners[i] += 1);
        assert_eq!(
            owners.iter().position(|&n| n != 1),
            None,
            "{of:?}: a weight that not exactly one optimiser updates"
        );
        assert!(matrices.iter().all(|h| h.rows <= h.columns), "{of:?}: a matrix seen with more rows than columns");
        // A layer has query, key, value, projection and two MLP matrices, or in a residual network gate, value and
        // output.
        let a_layer = if of == Architecture::Transformer { 6 } else { 3 };
        assert_eq!(matrices.len(), a_layer * network.layers, "{of:?}");
    }
}

/// The root mean square of a Muon update is a fifth of the learning rate. Adam's first update is the learning rate.
#[test]
fn updates_have_the_size_that_one_learning_rate_serves() {
    let (before, mut after) = (fresh(), fresh());
    let gradient: Vec<f32> = (0..NETWORK.parameters()).map(|i| ((i * i) as f64 * 0.37).sin() as f32 * 1e-3).collect();
    let config = LearnerConfig { optimizer: Optimizer::Muon, ..LEARNER };
    optimiser::step(optimiser::BETA, &mut after, &gradient, optimiser::norm(&gradient), 1e-2, &config);
    let moved = |i: usize| f64::from(after.weights.flat[i] - before.weights.flat[i]);
    for h in hidden(&NETWORK).concat() {
        let squares: f64 =
            (0..h.rows).flat_map(|r| (0..h.columns).map(move |c| h.at(r, c))).map(|i| moved(i).powi(2)).sum();
        let rms = (squares / (h.rows * h.columns) as f64).sqrt();
        assert!((1.4e-3..2.4e-3).contains(&rms), "a hidden matrix moved by {rms:.2e}, expected about 2e-3");
    }
    for i in others(&NETWORK).into_iter().flatten().filter(|&i| gradient[i].abs() > 1e-6) {
        assert!((moved(i).abs() - 1e-2).abs() < 2e-4, "weight {i} moved by {:.2e}, expected 1e-2", moved(i));
    }
}

/// In f32 the usual recursion at 0.9999 stops where `1e-4 |w - a|` is below half a unit in the last place, 3e-4 away.
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
