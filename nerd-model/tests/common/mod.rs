//! A small model of random weights.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use nerd_model::folder::{Model, ModelConfig};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{Positions, TransformerConfig, Weights};
use nerd_model::{base::Base, features::Features, form::Form};
use nerd_sim::prelude::*;

/// Windows and streams.
pub const POSITIONS: [Positions; 2] = [Positions::Table, Positions::Rotary];

/// A model of `system` whose predictions are added to `base`; none of it is learned.
pub fn model(system: &Arc<System>, base: Base) -> Model {
    placed(system, base, Positions::Table)
}

/// The same with positions of either kind.
pub fn placed(system: &Arc<System>, form: impl Into<Form>, positions: Positions) -> Model {
    let form = form.into();
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let network =
        TransformerConfig { embedding: 24, layers: 2, heads: 4, block: 16, positions, ..TransformerConfig::paper(inputs, outputs, 192) };
    let unit = |n: usize, variance: f64| Moments { mean: vec![0.0; n], variance: vec![variance; n], epsilon: 1e-5 };
    unlearned(system, form, network, Normalizer { inputs: unit(inputs, 4.0), outputs: unit(outputs, 0.01) })
}

/// A model of random weights, three times as large as training begins with.
pub fn unlearned(system: &System, form: impl Into<Form>, network: TransformerConfig, normalizer: Normalizer) -> Model {
    let Form { base, view } = form.into();
    let config = ModelConfig {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        model_sha256: String::new(),
        truth: Truth::default().name(),
        base,
        view,
        network,
        data_sha256: "none".into(),
        transitions: 0,
        updates: 0,
        batch: 0,
        provenance: Default::default(),
    };
    let mut weights = Weights::init(network, 5);
    weights.flat.iter_mut().for_each(|w| *w *= 3.0);
    Model { config, normalizer, weights }
}

/// Largest |difference|.
pub fn gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
