//! A tiny network and a synthetic linear map that it can learn.

// Each test file is a crate and uses a part of this.
#![allow(dead_code, unused_imports)]

pub use std::path::{Path, PathBuf};

pub use nerd_model::base::Base;
pub use nerd_model::features::Features;
pub use nerd_model::folder::{Model, ModelConfig};
pub use nerd_model::form::{Form, View};
pub use nerd_model::neural::Neural;
pub use nerd_model::normalizer::{Moments, Normalizer};
pub use nerd_model::program::cpu::{Loaded, Memory, Pass};
pub use nerd_model::transformer::{Architecture, Positions, TransformerConfig, Weights};
pub use nerd_sim::dataset::{GenerateConfig, record};
pub use nerd_sim::prelude::*;
pub use nerd_sim::sampling::normal;
pub use nerd_sim::trajectories::Trajectories;
pub use nerd_train::device::Device;
pub use nerd_train::evaluate::{Action, PassiveConfig, passive};
pub use nerd_train::learner::{
    BurnLearner, CpuLearner, LearnError, Learner, LearnerConfig, LearnerState, Optimizer, Progress, validation_rows,
};
pub use nerd_train::prepare::{moments, tokens};
pub use nerd_train::run::{Recipe, Run, RunConfig, Variant};
pub use nerd_train::schedule::Schedule;
pub use nerd_train::settings::Given;
pub use nerd_train::spec::SolverSpec;
pub use nerd_train::supply::{Supply, SupplyConfig};
pub use nerd_train::trainer::TrainerConfig;
pub use nerd_train::windows::Windows;

#[path = "../../../nerd-model/tests/common/mod.rs"]
pub mod models;

pub use models::unlearned;

/// About three thousand parameters.
pub const NETWORK: TransformerConfig = TransformerConfig {
    inputs: 3,
    outputs: 2,
    embedding: 16,
    layers: 1,
    heads: 2,
    block: 4,
    history: 4,
    head: 8,
    positions: Positions::Table,
    architecture: Architecture::Transformer,
};

/// 24 windows an update, clip 1, moving average 0.99.
pub const LEARNER: LearnerConfig =
    LearnerConfig { batch: 24, clip: 1.0, average: 0.99, seed: 7, huber: None, optimizer: Optimizer::Adam };

/// 30 trajectories of 12 frames: `y0 = x0 - x1 / 2`, `y1 = x2`.
pub fn windows(phase: f32) -> Arc<Windows> {
    let (trajectories, frames) = (30, 12);
    let x: Vec<f32> = (0..trajectories * frames * 3)
        .map(|i| (i as f32 * 1.618 + phase + (i as f32 * 0.31).sin() * 3.0).sin() * 1.4)
        .collect();
    let y = x.chunks(3).flat_map(|x| [x[0] - 0.5 * x[1], x[2]]).collect();
    Arc::new(Windows { inputs: 3, outputs: 2, frames, history: 4, x, y })
}

/// A learner on the CPU that continues `state`.
pub fn learner(state: LearnerState) -> CpuLearner {
    CpuLearner::new(LEARNER, state, [windows(0.0), windows(0.5)]).expect("windows fit the network")
}

pub fn fresh() -> LearnerState {
    LearnerState::new(Weights::init(NETWORK, 3))
}

/// A small untrained model with random weights and small outputs, so that its base dominates the motion.
pub fn model(system: &Arc<System>, base: Base, positions: Positions) -> Model {
    let (inputs, outputs) = (Features::inputs(system, base), Features::outputs(system));
    let network = TransformerConfig {
        embedding: 24,
        layers: 2,
        heads: 4,
        block: 16,
        positions,
        ..TransformerConfig::paper(inputs, outputs, 24)
    };
    let (mut nothing, state) = (vec![0.0f32; outputs], system.default_state());
    Features::new(system, base).target(&state, &state, &mut nothing);
    let moments = |mean: Vec<f64>, variance: f64| Moments { variance: vec![variance; mean.len()], mean, epsilon: 1e-5 };
    let normalizer = Normalizer {
        inputs: moments(vec![0.0; inputs], 4.0),
        outputs: moments(nothing.into_iter().map(f64::from).collect(), 1e-4),
    };
    unlearned(system, base, network, normalizer)
}
