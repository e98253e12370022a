//! [`Forward`] over whole windows; behind the last mixing of tokens the newest alone are computed.

use rayon::prelude::*;

use super::ROWS;
use crate::program::cpu::{Loaded, Memory, Pass};
use crate::transformer::{Forward, ForwardError, TransformerConfig, Weights};

/// A network that recomputes windows.
pub struct PackedForward {
    config: TransformerConfig,
    network: Loaded,
    memory: Vec<Memory>,
}

impl PackedForward {
    /// Packs `weights`.
    pub fn new(weights: &Weights) -> Self {
        Self { config: weights.config, network: Loaded::new(weights.config.program(), &weights.flat), memory: Vec::new() }
    }
}

impl Forward for PackedForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        crate::transformer::check(&self.config, inputs, tokens, last)?;
        let (c, network) = (self.config, &self.network);
        out.clear();
        out.resize(last.len() * c.outputs, 0.0);
        // Blocks of whole windows, as many as keep every thread busy.
        let most = (ROWS / tokens).max(1);
        let threads = rayon::current_num_threads();
        let size = last.len().div_ceil(threads * last.len().div_ceil(threads * most).max(1)).max(1);
        self.memory.resize_with(self.memory.len().max(last.len().div_ceil(size)), Memory::default);
        let jobs = inputs.par_chunks(size * tokens * c.inputs).zip(last.par_chunks(size)).zip(out.par_chunks_mut(size * c.outputs));
        jobs.zip(self.memory.par_iter_mut()).for_each(|(((x, last), out), memory)| {
            let newest: Vec<usize> = last.iter().enumerate().map(|(w, l)| w * tokens + *l as usize).collect();
            out.copy_from_slice(network.forward(x, memory, Pass::Windows(tokens, &newest)));
        });
        Ok(())
    }
}
