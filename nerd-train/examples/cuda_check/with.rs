//! What is checked with: numbers, windows, weights.

use std::error::Error;

use nerd_model::transformer::{TransformerConfig, Weights};
use nerd_train::learner::cuda::{CudaLearner, Precision};
use nerd_train::learner::{LearnerConfig, LearnerState};
use nerd_train::windows::{Windows, draw};

/// Uniform in +-1, a hash of `i`.
pub fn noise(stream: u64, i: usize) -> f32 {
    (draw(stream, 0, i as u64, 1 << 24) as f32 / (1 << 23) as f32) - 1.0
}

/// So many of them.
pub fn numbers(stream: u64, n: usize) -> Vec<f32> {
    (0..n).map(|i| noise(stream, i)).collect()
}

/// Largest difference; none of a number if there is one that is none.
pub fn largest(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

/// Random inputs; the targets mix the present and the previous token, so that attention has something to find.
pub fn windows(stream: u64, config: TransformerConfig, trajectories: usize, frames: usize) -> Windows {
    let (i, o) = (config.inputs, config.outputs);
    let x: Vec<f32> = (0..trajectories * frames * i).map(|k| noise(stream, k)).collect();
    let y = (0..trajectories * frames * o).map(|k| {
        let (token, c) = (k / o, k % o);
        let before = if token % frames == 0 { 0.0 } else { x[(token - 1) * i + c % i] };
        x[token * i + c % i] + 0.5 * (2.0 * before).sin() - x[token * i] * x[token * i + i - 1]
    });
    Windows { inputs: i, outputs: o, frames, history: config.sequence(), y: y.collect(), x }
}

/// Weights with no entry at a special value (zero biases, unit norms).
pub fn weights(config: TransformerConfig, size: f32) -> Weights {
    let mut w = Weights::init(config, 1);
    w.flat.iter_mut().enumerate().for_each(|(i, x)| *x += size * noise(7, i));
    w
}

pub fn configuration(batch: usize) -> LearnerConfig {
    LearnerConfig { batch, clip: 1.0, average: 0.999, seed: 5, huber: None, optimizer: Default::default() }
}

pub fn learner(batch: usize, precision: Precision, scale: f32) -> Result<CudaLearner, Box<dyn Error>> {
    learner_of(TransformerConfig::paper(37, 4, 192), batch, precision, scale)
}

pub fn learner_of(config: TransformerConfig, batch: usize, precision: Precision, scale: f32) -> Result<CudaLearner, Box<dyn Error>> {
    let state = LearnerState::new(weights(config, 0.05 * scale));
    Ok(CudaLearner::new(configuration(batch), precision, state, &windows(2, config, 200, 100), &windows(3, config, 20, 100))?)
}
