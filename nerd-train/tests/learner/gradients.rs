//! The hand-written backward pass on the CPU against burn's autodiff.

use crate::*;

/// Table and rotary positions, an attention band narrower than the sequence, head widths that fill no vector register.
/// One network has no attention.
const SHAPES: [TransformerConfig; 5] = [
    NETWORK,
    TransformerConfig { embedding: 36, heads: 3, layers: 3, block: 7, head: 5, ..NETWORK },
    TransformerConfig { block: 11, history: 3, layers: 2, positions: Positions::Rotary, ..NETWORK },
    TransformerConfig { embedding: 60, heads: 6, block: 9, history: 9, positions: Positions::Rotary, ..NETWORK },
    TransformerConfig { architecture: Architecture::Residual, ..NETWORK },
];

/// A state with windows cut to the network's sequence. Weights are far enough from 0 that attention is not uniform.
fn case(network: TransformerConfig) -> (LearnerState, Arc<Windows>) {
    let mut weights = Weights::init(network, 3);
    weights.flat.iter_mut().enumerate().for_each(|(i, w)| *w += 0.3 * (i as f32 * 0.7).sin());
    let windows = Windows { history: network.sequence(), ..Arc::unwrap_or_clone(windows(0.0)) };
    (LearnerState::new(weights), Arc::new(windows))
}

#[test]
fn gradient_is_burns_for_every_shape_and_loss() {
    let rows: Vec<u64> = (0..40).collect();
    for network in SHAPES {
        for huber in [None, Some(0.1)] {
            let (state, windows) = case(network);
            let config = LearnerConfig { huber, ..LEARNER };
            let mut cpu =
                CpuLearner::new(config, state.clone(), [windows.clone(), windows.clone()]).expect("windows fit");
            let device = nerd_model::BurnDevice::flex();
            let mut burn = BurnLearner::new(config, state, [windows.clone(), windows], &device).expect("windows fit");
            let (expected, found) = (burn.gradient(&rows).expect("finite"), cpu.gradient(&rows).expect("finite"));
            assert!(
                (found.0 / expected.0 - 1.0).abs() < 1e-5,
                "{network:?}: loss {} for burn's {}",
                found.0,
                expected.0
            );
            let mut first = 0;
            for tensor in network.tensors() {
                let range = first..first + tensor.len();
                first = range.end;
                let (a, b) = (&found.1[range.clone()], &expected.1[range]);
                let largest = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
                let off = a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / largest;
                assert!(
                    off < 3e-5,
                    "{network:?}, huber {huber:?}, {}: off by {off:.1e} of the largest entry {largest:.1e}",
                    tensor.name
                );
            }
            let (a, b) = (cpu.validate(20).expect("finite"), burn.validate(20).expect("finite"));
            assert!((a / b - 1.0).abs() < 1e-5, "{network:?}: validation loss {a} for burn's {b}");
        }
    }
}

/// Updates reuse memory; another number of windows must not see old content.
#[test]
fn an_update_leaves_nothing_to_the_next() {
    let (state, windows) = case(SHAPES[2]);
    let fresh = || CpuLearner::new(LEARNER, state.clone(), [windows.clone(), windows.clone()]).expect("windows fit");
    let used = fresh();
    for rows in [(0..60).collect::<Vec<u64>>(), vec![5], (3..40).collect()] {
        let found = used.gradient(&rows).expect("finite");
        assert!(
            found == fresh().gradient(&rows).expect("finite"),
            "{} windows: not what a new learner finds",
            rows.len()
        );
    }
}

/// Validation windows are spread from the first trajectory to the last, and are the same on every engine.
#[test]
fn a_validation_looks_at_the_same_windows_on_every_engine() {
    for (windows, wanted) in [(270, 20), (270, 199), (270, 270), (270, 10_000), (3, 2), (1, 0)] {
        let rows = validation_rows(windows, wanted);
        assert_eq!(rows.len(), wanted.clamp(1, windows), "{wanted} of {windows}");
        assert!(
            rows.is_sorted_by(|a, b| a < b) && rows.iter().all(|row| *row < windows as u64),
            "{wanted} of {windows}: {rows:?}"
        );
        let left = windows as u64 - rows.last().expect("one at least");
        assert!(
            left <= windows.div_ceil(rows.len()) as u64,
            "{wanted} of {windows}: the last {left} are never looked at"
        );
    }
    let (state, windows) = case(NETWORK);
    let mut cpu = CpuLearner::new(LEARNER, state.clone(), [windows.clone(), windows.clone()]).expect("windows fit");
    for wanted in [20, 199] {
        // The loss of the chosen windows alone, as the gradient computes it.
        let expected = cpu.gradient(&validation_rows(windows.len(), wanted)).expect("finite").0;
        let found = cpu.validate(wanted).expect("finite");
        assert!((found / expected - 1.0).abs() < 1e-6, "{wanted} windows: {found}, the chosen ones have {expected}");
    }
}

#[test]
fn what_is_no_number_ends_the_run() {
    for tensor in NETWORK.tensors() {
        let (mut state, windows) = case(NETWORK);
        let first: usize = NETWORK.tensors().iter().take_while(|t| t.name != tensor.name).map(|t| t.len()).sum();
        state.weights.flat[first] = f32::NAN;
        let mut cpu = CpuLearner::new(LEARNER, state, [windows.clone(), windows]).expect("windows fit");
        let error = cpu.update(1e-3).expect_err(&format!("NaN in {} is swallowed", tensor.name));
        assert!(error.to_string().contains("update 0"), "{}: {error}", tensor.name);
        assert_eq!(cpu.state().expect("a state").step, 0, "{}", tensor.name);
    }
}
