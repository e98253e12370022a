//! Helpers of the checks: imports, pseudo-random numbers, windows, weights, error measures.

use std::error::Error;
pub use std::path::Path;
pub use std::sync::Mutex;
pub use std::time::Instant;

pub use nerd_model::folder::Model;
pub use nerd_model::transformer::{Architecture, ForwardError, Positions, Stream, TransformerConfig, Weights};
pub use nerd_sim::articulated::device::{CudaArticulated, Reach, Real};
pub use nerd_sim::dataset::GenerateConfig;
pub use nerd_sim::prelude::*;
pub use nerd_tasks::{Episodes, named};
pub use nerd_train::device::Device;
pub use nerd_train::learner::cuda::{CudaLearner, CudaStream, Precision};
pub use nerd_train::learner::{CpuLearner, Learner, LearnerConfig, LearnerState, Optimizer};
pub use nerd_train::ppo::{
    Adam, Arena, CudaEngine, CudaShac, Engine, Policy, PpoConfig, RolloutInput, Running, Shac, StreamKey, Trainer,
};
pub use nerd_train::spec::{SolverSpec, resident};
pub use nerd_train::windows::{Windows, draw};

pub type Outcome<T = ()> = Result<T, Box<dyn Error>>;

#[derive(Default)]
pub struct Checks {
    failed: usize,
}

impl Checks {
    pub fn demand(&mut self, right: bool, what: String) {
        println!("{} {what}", if right { "  " } else { "NO" });
        self.failed += usize::from(!right);
    }

    pub fn end(self) -> Outcome {
        if self.failed == 0 { Ok(()) } else { Err(format!("{} checks failed", self.failed).into()) }
    }
}

/// Uniform in [-1, 1), a hash of `stream` and `i`.
pub fn noise(stream: u64, i: usize) -> f32 {
    (draw(stream, 0, i as u64, 1 << 24) as f32 / (1 << 23) as f32) - 1.0
}

/// The first `n` numbers of a stream.
pub fn numbers(stream: u64, n: usize) -> Vec<f32> {
    (0..n).map(|i| noise(stream, i)).collect()
}

/// Largest of `all` and `most`; NaN if any is NaN.
pub fn worse<T: PartialOrd>(most: T, all: impl IntoIterator<Item = T>) -> T {
    all.into_iter().fold(most, |most, x| if x > most || x.partial_cmp(&x).is_none() { x } else { most })
}

/// Largest |a - b| / (1 + |b|); NaN if any is NaN.
pub fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    worse(0.0, a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())))
}

/// Largest |a - b|, relative to the largest |b| (at least 1e-3); NaN if any is NaN.
pub fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1e-3f32, |m, x| m.max(x.abs()));
    worse(0.0, a.iter().zip(b).map(|(a, b)| (a - b).abs() / scale))
}

/// |a - b| / |b - first|: the error of weights, relative to the change since `first`.
pub fn share_of_way(a: &[f32], b: &[f32], first: &[f32]) -> f64 {
    let norm = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
    norm(a, b) / norm(b, first)
}

/// Random inputs. Targets mix the present and the previous token, so that attention has something to learn.
pub fn windows(stream: u64, config: TransformerConfig, trajectories: usize, frames: usize) -> Windows {
    let (i, o) = (config.inputs, config.outputs);
    let x = numbers(stream, trajectories * frames * i);
    let y = (0..trajectories * frames * o).map(|k| {
        let (token, c) = (k / o, k % o);
        let before = if token % frames == 0 { 0.0 } else { x[(token - 1) * i + c % i] };
        x[token * i + c % i] + 0.5 * (2.0 * before).sin() - x[token * i] * x[token * i + i - 1]
    });
    Windows { inputs: i, outputs: o, frames, history: config.sequence(), y: y.collect(), x }
}

/// Weights with no entry at a special value (zero biases, unit norms).
pub fn weights(config: TransformerConfig) -> Weights {
    let mut w = Weights::init(config, 1);
    w.flat.iter_mut().enumerate().for_each(|(i, x)| *x += 0.05 * noise(7, i));
    w
}

pub fn settings(batch: usize) -> LearnerConfig {
    LearnerConfig { batch, clip: 1.0, average: 0.999, seed: 5, huber: None, optimizer: Default::default() }
}

/// Networks without attention: residual and chain.
pub fn others() -> [TransformerConfig; 2] {
    let of = |architecture, outputs, embedding| TransformerConfig {
        architecture,
        layers: 2,
        heads: 1,
        ..TransformerConfig::paper(37, outputs, embedding)
    };
    [of(Architecture::Residual, 4, 52), TransformerConfig { layers: 8, block: 10, ..of(Architecture::Chain, 6, 48) }]
}

/// Networks with position table or rotary positions, wide or narrow heads, short bands, more outputs than lanes; and
/// networks without attention.
pub fn shapes() -> Vec<TransformerConfig> {
    let paper = TransformerConfig::paper;
    let rotary = |c: TransformerConfig, block| TransformerConfig { positions: Positions::Rotary, block, ..c };
    let small = TransformerConfig { layers: 2, heads: 4, history: 7, ..paper(10, 33, 48) };
    let wide = paper(37, 4, 192);
    // As many tokens as a block has threads, so the block opts in to more shared memory.
    let long = rotary(TransformerConfig { history: 32, ..wide }, 128);
    let narrow = rotary(TransformerConfig { heads: 3, ..small }, 20);
    let all = [
        wide,
        paper(6, 14, 384),
        small,
        rotary(wide, 32),
        rotary(wide, 55),
        rotary(paper(37, 4, 384), 64),
        narrow,
        long,
    ];
    let transformers = all.map(|c| TransformerConfig { layers: c.layers.min(3), ..c });
    transformers.into_iter().chain(others()).collect()
}
