//! Evaluation of networks over windows: the interface to any engine, and the CPU engine.
//!
//! On the CPU rows are split into blocks, one per thread at a time, with activations in the L2 cache. After the last
//! step that mixes tokens, only the newest token of each window is computed.

use rayon::prelude::*;

use super::weights::Weights;
use crate::program::config::{Positions, TransformerConfig};
use crate::program::cpu::{Loaded, Memory, Pass};

/// Evaluates a network on windows.
pub trait Forward: Send {
    /// Predictions at the newest token of each window, in normalised target units.
    ///
    /// `inputs` is `[windows][tokens][inputs]`, normalised, row-major, the oldest token first. `last[w]` is the index
    /// of the newest token of window `w`; later tokens are padding of any finite value. `out` is replaced by
    /// `[windows][outputs]`.
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> ForwardResult;
}

/// Why a network could not be evaluated.
#[derive(Debug, thiserror::Error)]
#[error("network: {message}")]
pub struct ForwardError {
    /// Why the network could not be evaluated.
    pub message: String,
}

/// Predictions, or why there are none.
pub type ForwardResult<T = ()> = Result<T, ForwardError>;

/// Refuses windows that do not fit the network.
pub(crate) fn check(config: &TransformerConfig, inputs: &[f32], tokens: usize, last: &[u32]) -> ForwardResult {
    let expected = last.len() * tokens * config.inputs;
    let message = if tokens == 0 || (config.positions == Positions::Table && tokens > config.block) {
        format!("{tokens} tokens in a window, the position table has {}", config.block)
    } else if inputs.len() != expected {
        format!(
            "{} input values, expected {} windows x {tokens} tokens x {} = {expected}",
            inputs.len(),
            last.len(),
            config.inputs
        )
    } else if let Some(w) = last.iter().position(|&l| l as usize >= tokens) {
        format!("window {w}: newest token {} of {tokens}", last[w])
    } else {
        return Ok(());
    };
    Err(ForwardError { message })
}

pub(super) const ROWS: usize = 512;

/// Block size for `n` items: blocks of equal size, at most `most`, enough of them to keep every thread busy.
pub(crate) fn even(n: usize, most: usize) -> usize {
    let threads = rayon::current_num_threads();
    n.div_ceil(threads * n.div_ceil(threads * most).max(1)).max(1)
}

/// A network on the CPU that evaluates windows.
pub struct PackedForward {
    config: TransformerConfig,
    network: Loaded,
    memory: Vec<Memory>,
}

impl PackedForward {
    /// Packs `weights`.
    pub fn new(weights: &Weights) -> Self {
        Self {
            config: weights.config,
            network: Loaded::new(weights.config.program(), &weights.flat),
            memory: Vec::new(),
        }
    }
}

impl Forward for PackedForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> ForwardResult {
        check(&self.config, inputs, tokens, last)?;
        let c = self.config;
        let network = &self.network;
        out.clear();
        out.resize(last.len() * c.outputs, 0.0);
        let size = even(last.len(), (ROWS / tokens).max(1));
        self.memory.resize_with(self.memory.len().max(last.len().div_ceil(size)), Memory::default);
        let jobs = inputs
            .par_chunks(size * tokens * c.inputs)
            .zip(last.par_chunks(size))
            .zip(out.par_chunks_mut(size * c.outputs));
        jobs.zip(self.memory.par_iter_mut()).for_each(|(((x, last), out), memory)| {
            let newest: Vec<usize> = last.iter().enumerate().map(|(w, l)| w * tokens + *l as usize).collect();
            out.copy_from_slice(network.forward(x, memory, Pass::Windows(tokens, &newest)));
        });
        Ok(())
    }
}
