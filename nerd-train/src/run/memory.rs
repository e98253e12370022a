//! Estimates the memory of a run, and refuses a run that needs too much before it begins.

use super::*;
use crate::bounds::memory;
use crate::unroll::ROLLOUTS;

/// Windows that one thread of the CPU learner processes at a time.
const SHARD: usize = 32;

/// Refuses a run that needs more memory than is free.
pub(super) fn check(config: &RunConfig, network: &TransformerConfig) -> Result<()> {
    let batch = config.batch;
    // Three f32 copies: the shards, the joined data set, and the copy made while it grows.
    memory(&[("--transitions", config.transitions)], 3 * 4 * (network.inputs + network.outputs))?;
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let on_cpu = config.device == Device::Cpu;
    // Copies of the parameters: weights, average, two moments, and those for checkpoints and rollouts. The CPU learner
    // also has a network per thread and a gradient per shard.
    let copies = 10 + if on_cpu { 2 * threads + batch.div_ceil(SHARD) } else { 0 };
    memory(&[("parameters", network.parameters()), ("copies", copies)], 4)?;
    if on_cpu {
        memory(&[("--batch", batch.min(threads * SHARD)), ("tokens", network.sequence())], 4 * of_token(network))?;
    }
    let kept = match network.positions {
        Positions::Rotary => network.layers * 2 * network.embedding,
        Positions::Table => of_token(network),
    };
    memory(&[("--rollouts", config.rollouts), ("--history", network.history)], 4 * (kept + network.inputs))
}

/// Refuses training rollouts of `frames` frames if their activations do not fit in memory: each thread keeps all
/// frames.
pub(super) fn unrolled(network: &TransformerConfig, frames: usize) -> Result<()> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let row = 10 * network.layers * network.embedding + 2 * (network.embedding + network.inputs + network.outputs);
    memory(&[("--sequence", frames), ("threads", threads), ("tokens of a thread", ROLLOUTS * network.block)], 4 * row)
}

/// Estimates how many f32 numbers a forward and backward pass keeps per token.
fn of_token(network: &TransformerConfig) -> usize {
    let TransformerConfig { inputs, outputs, embedding, layers, heads, history, head, .. } = *network;
    layers * (24 * embedding + 2 * heads * history) + 8 * embedding + 4 * head + inputs + outputs
}
