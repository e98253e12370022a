//! Networks on the CPU without a tensor framework: their [programs](crate::program), packed.
//!
//! Rows are cut into blocks whose activations stay in the second-level cache, one block to a thread at a time.

mod attention;
mod stream;
mod window;

use super::config::{Architecture, Positions};
use super::stream::{Stream, Windowed};
use super::weights::Weights;

pub use stream::PackedStream;
pub use window::PackedForward;

/// The fastest evaluator on the CPU: remembering if a network's positions allow it, or else recomputing windows.
pub fn packed(weights: &Weights) -> Box<dyn Stream> {
    match (weights.config.architecture, weights.config.positions) {
        (Architecture::Transformer, Positions::Rotary) => Box::new(PackedStream::new(weights)),
        _ => Box::new(Windowed::new(PackedForward::new(weights), weights.config)),
    }
}

/// Rows (tokens) of a block.
const ROWS: usize = 512;
