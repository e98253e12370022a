//! Weights of networks, and their evaluation over windows and streams.

#[cfg(feature = "burn")]
mod burn;
mod forward;
mod rotary;
mod stream;
mod weights;

#[cfg(feature = "burn")]
pub use self::burn::BurnForward;
pub use crate::program::config::{Architecture, Positions, TransformerConfig};
pub use crate::program::{Init, TensorSpec};
pub(crate) use forward::even;
pub use forward::{Forward, ForwardError, ForwardResult, PackedForward};
pub use rotary::PackedStream;
pub use stream::{Stream, Windowed};
pub use weights::{Storage, Weights, WeightsError};

/// The fastest CPU evaluator: a stream with cached keys and values if positions are rotary, otherwise recomputed
/// windows.
pub fn packed(weights: &Weights) -> Box<dyn Stream> {
    match (weights.config.architecture, weights.config.positions) {
        (Architecture::Transformer, Positions::Rotary) => Box::new(PackedStream::new(weights)),
        _ => Box::new(Windowed::new(PackedForward::new(weights), weights.config)),
    }
}
