//! [`Forward`] through the burn module, in chunks and on several threads.
//!
//! A chunk's activations should stay in the second-level cache, and burn's CPU backend runs its element-wise work on
//! one thread: so windows are cut in chunks, and on the CPU the chunks are spread over threads. A window's result
//! does not depend on the chunk it stands in beyond rounding.

use std::sync::atomic::{AtomicUsize, Ordering};

use burn::tensor::{Device, Tensor, TensorData};

use super::config::{Positions, TransformerConfig};
use super::forward::{Forward, ForwardError};
use super::network::Transformer;
use super::weights::Weights;

/// Windows evaluated at once by one thread.
const CHUNK: usize = 64;

/// A network on a burn device without autodiff.
#[derive(Debug)]
pub struct BurnForward {
    network: Transformer,
    config: TransformerConfig,
    device: Device,
    chunk: usize,
    threads: usize,
}

impl BurnForward {
    /// The network on `device`, in chunks of 64 windows on as many threads as rayon has here.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        let threads = rayon::current_num_threads();
        let device = device.clone().inner();
        Self { network: Transformer::new(weights, &device), config: weights.config, device, chunk: CHUNK, threads }
    }

    /// Another chunk size and number of threads (a GPU wants thousands of windows and one thread).
    pub fn chunks(mut self, chunk: usize, threads: usize) -> Self {
        (self.chunk, self.threads) = (chunk.max(1), threads.max(1));
        self
    }

    fn chunk(&self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut [f32]) -> Result<(), ForwardError> {
        let data = TensorData::new(inputs.to_vec(), [last.len(), tokens, self.config.inputs]);
        let y = self.network.forward_last(Tensor::from_data(data, &self.device), last);
        let y = y.try_into_data().map_err(|e| ForwardError { message: format!("{e:?}") })?;
        out.iter_mut().zip(y.iter::<f32>()).for_each(|(o, y)| *o = y);
        Ok(())
    }
}

impl Forward for BurnForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        check(&self.config, inputs, tokens, last)?;
        out.clear();
        out.resize(last.len() * self.config.outputs, 0.0);
        // Even chunks, so that no thread is left with a small one; at least 8 windows, or threads cost more than they give.
        let pieces = last.len().div_ceil(self.chunk).max(self.threads.min(last.len() / 8)).max(1);
        let chunk = last.len().div_ceil(pieces).max(1);
        let jobs =
            inputs.chunks(chunk * tokens * self.config.inputs).zip(last.chunks(chunk)).zip(out.chunks_mut(chunk * self.config.outputs));
        let threads = self.threads.min(pieces);
        if threads == 1 {
            return jobs.into_iter().try_for_each(|((x, l), o)| self.chunk(x, tokens, l, o));
        }
        let jobs: Vec<_> = jobs.map(|job| std::sync::Mutex::new(Some(job))).collect();
        let next = AtomicUsize::new(0);
        let work = || -> Result<(), ForwardError> {
            while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                let job = job.lock().ok().and_then(|mut j| j.take());
                let Some(((x, l), o)) = job else { continue };
                self.chunk(x, tokens, l, o)?;
            }
            Ok(())
        };
        std::thread::scope(|scope| {
            let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
            let mine = work();
            others.into_iter().fold(mine, |result, other| {
                result.and(other.join().unwrap_or_else(|_| Err(ForwardError { message: "a worker thread panicked".into() })))
            })
        })
    }
}

/// Refuses windows that do not fit a network.
pub(crate) fn check(config: &TransformerConfig, inputs: &[f32], tokens: usize, last: &[u32]) -> Result<(), ForwardError> {
    let expected = last.len() * tokens * config.inputs;
    let message = if tokens == 0 || (config.positions == Positions::Table && tokens > config.block) {
        format!("{tokens} tokens in a window, the position table has {}", config.block)
    } else if inputs.len() != expected {
        format!("{} input values, expected {} windows x {tokens} tokens x {} = {expected}", inputs.len(), last.len(), config.inputs)
    } else if let Some(w) = last.iter().position(|&l| l as usize >= tokens) {
        format!("window {w}: newest token {} of {tokens}", last[w])
    } else {
        return Ok(());
    };
    Err(ForwardError { message })
}
