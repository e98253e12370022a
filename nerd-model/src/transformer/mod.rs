//! The causal Transformer.

mod attention;
mod block;
mod config;
mod elementwise;
mod forward;
mod network;
mod packed;
mod predictor;
mod weights;

pub use attention::{Attention, causal_mask, newest_mask};
pub use block::Block;
pub use config::{Init, TensorSpec, TransformerConfig};
pub use forward::{Forward, ForwardError};
pub use network::Transformer;
pub use packed::PackedForward;
pub use predictor::BurnForward;
pub use weights::{Weights, WeightsError};
