//! The learner on the networks that NeRD is compared with.

mod common;

use common::{LEARNER, NETWORK, windows};
use nerd_model::transformer::{Architecture, TransformerConfig, Weights};
use nerd_train::learner::muon::{hidden, others};
use nerd_train::learner::{BurnLearner, Learner, LearnerConfig, LearnerState, Optimizer};

const RIVALS: [Architecture; 3] = [Architecture::Mlp, Architecture::Gru, Architecture::Lstm];

fn network(architecture: Architecture) -> TransformerConfig {
    TransformerConfig { architecture, layers: 2, ..NETWORK }
}

fn learner(state: LearnerState, optimizer: Optimizer) -> BurnLearner {
    let config = LearnerConfig { optimizer, ..LEARNER };
    BurnLearner::new(config, state, windows(0.0), windows(0.5), &nerd_model::BurnDevice::flex()).expect("windows fit")
}

/// Central differences along the gradient, f32 losses.
#[test]
fn gradient_is_the_slope_of_the_loss() {
    let rows: Vec<u64> = (0..24).map(|i| i * 11).collect();
    for architecture in RIVALS {
        let state = LearnerState::new(Weights::init(network(architecture), 3));
        let (_, gradient) = learner(state.clone(), Optimizer::Adam).gradient(&rows).expect("finite");
        assert_eq!(gradient.len(), network(architecture).parameters(), "{architecture:?}");
        let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
        let loss = |h: f32| {
            let mut moved = state.clone();
            moved.weights.flat.iter_mut().zip(&gradient).for_each(|(w, g)| *w += h * g / norm);
            f64::from(learner(moved, Optimizer::Adam).gradient(&rows).expect("finite").0)
        };
        let slope = (loss(0.01) - loss(-0.01)) / 0.02;
        assert!((slope / f64::from(norm) - 1.0).abs() < 0.01, "{architecture:?}: finite difference {slope:.6}, gradient {norm:.6}");
    }
}

#[test]
fn every_weight_belongs_to_one_of_the_two_optimisers() {
    for architecture in RIVALS {
        let network = network(architecture);
        let mut owners = vec![0; network.parameters()];
        let matrices = hidden(&network).concat();
        matrices.iter().for_each(|h| (0..h.rows).for_each(|r| (0..h.columns).for_each(|c| owners[h.at(r, c)] += 1)));
        others(&network).into_iter().flatten().for_each(|i| owners[i] += 1);
        assert_eq!(owners.iter().position(|&n| n != 1), None, "{architecture:?}: a weight that not exactly one optimiser updates");
        assert!(matrices.iter().all(|h| h.rows <= h.columns), "{architecture:?}: a matrix seen with more rows than columns");
        // Two hidden layers of the perceptron; three or four gates of two states and of one token between cells.
        let expected = match architecture {
            Architecture::Mlp => 2,
            Architecture::Gru => 9,
            _ => 12,
        };
        assert_eq!(matrices.len(), expected, "{architecture:?}");
    }
}

#[test]
fn a_linear_map_is_learnt() {
    for architecture in RIVALS {
        for optimizer in [Optimizer::Adam, Optimizer::Muon] {
            let mut learner = learner(LearnerState::new(Weights::init(network(architecture), 3)), optimizer);
            let before = learner.validate(1000).expect("finite");
            (0..600).for_each(|_| learner.update(3e-3).expect("finite"));
            let after = learner.validate(1000).expect("finite");
            assert!(after < before / 20.0, "{architecture:?}, {optimizer:?}: validation loss {before:.3} -> {after:.4}");
        }
    }
}
