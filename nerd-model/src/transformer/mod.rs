//! The causal Transformer.

mod attention;
mod block;
mod config;
mod elementwise;
mod forward;
mod network;
mod packed;
mod places;
mod predictor;
mod stream;
mod weights;

pub use attention::Attention;
pub use block::Block;
pub use config::{Init, Positions, TensorSpec, TransformerConfig};
pub use forward::{Forward, ForwardError};
pub use network::Transformer;
pub use packed::{PackedForward, PackedStream, packed};
pub use places::Places;
pub use predictor::BurnForward;
pub use stream::{Stream, Windowed};
pub use weights::{Storage, Weights, WeightsError};
