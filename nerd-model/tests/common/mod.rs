//! Small models of random weights, batches, and comparisons of numbers.

// Each test file is a separate crate and uses only part of this module.
#![allow(dead_code)]

use nerd_model::folder::{Model, ModelConfig};
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::transformer::{Architecture, Positions, TransformerConfig, Weights};
use nerd_model::{base::Base, features::Features, form::Form, form::View};
use nerd_sim::prelude::*;

pub const POSITIONS: [Positions; 2] = [Positions::Table, Positions::Rotary];

/// An untrained model of `system` with predictions added to `base`.
pub fn model(system: &Arc<System>, base: Base) -> Model {
    placed(system, base, Positions::Table)
}

/// As `model`, in a form and with positions of either kind.
pub fn placed(system: &Arc<System>, form: impl Into<Form>, positions: Positions) -> Model {
    let form = form.into();
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let network = TransformerConfig {
        embedding: 24,
        layers: 2,
        heads: 4,
        block: 16,
        positions,
        ..TransformerConfig::paper(inputs, outputs, 192)
    };
    let unit = |n: usize, variance: f64| Moments { mean: vec![0.0; n], variance: vec![variance; n], epsilon: 1e-5 };
    unlearned(system, form, network, Normalizer { inputs: unit(inputs, 4.0), outputs: unit(outputs, 0.01) })
}

/// A model with a one-frame network, [`View::Moving`] and the trapezoid base. Moments: `mean` of tokens and outputs,
/// variance `said` of outputs.
pub fn pure(system: &Arc<System>, mean: f64, said: f64) -> Model {
    let form = Form { view: View::Moving, ..Base::Trapezoid.into() };
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let paper = TransformerConfig::paper(inputs, outputs, 24);
    let network =
        TransformerConfig { layers: 2, heads: 1, block: 1, history: 1, architecture: Architecture::Residual, ..paper };
    let unit = |n: usize, variance: f64| Moments { mean: vec![mean; n], variance: vec![variance; n], epsilon: 1e-5 };
    unlearned(system, form, network, Normalizer { inputs: unit(inputs, 1.0), outputs: unit(outputs, said) })
}

/// A model of random weights, three times as large as initial ones.
pub fn unlearned(system: &System, form: impl Into<Form>, network: TransformerConfig, normalizer: Normalizer) -> Model {
    let Form { base, view, told } = form.into();
    let config = ModelConfig {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        model_sha256: String::new(),
        truth: Truth::default().name(),
        base,
        view,
        told,
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

pub fn gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// `n` environments from start states of a seed, after some frames of the truth.
pub fn fallen(system: &Arc<System>, scene: &str, n: usize, (begin, seed): (Start, u64), frames: usize) -> Batch {
    let mut batch = Batch::new(system, &system.scene(scene).expect("a scene"), n);
    (0..n).for_each(|env| batch.reset(env, &start(system, begin, &mut stream(seed, env as u64))));
    let (mut truth, idle) =
        (Articulated::new(ArticulatedConfig::accurate(system)), vec![0.0; n * system.robot.joint_count()]);
    (0..frames).for_each(|_| truth.step(&mut batch, &idle).expect("it can be stepped"));
    batch
}

/// Deterministic numbers about 0, of about this size.
pub fn some(n: usize, size: f64) -> Vec<f64> {
    (0..n).map(|k| size * (1.7 * k as f64 + 0.3).sin()).collect()
}

/// The larger of two; NaN is the worst.
pub fn worse(most: f64, off: f64) -> f64 {
    if off > most || off.is_nan() { off } else { most }
}

/// The largest difference, relative to the largest expected number.
pub fn worst(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(1e-9, |most: f64, x| most.max(x.abs()));
    found.iter().zip(expected).map(|(a, b)| (a - b).abs() / largest).fold(0.0, worse)
}
