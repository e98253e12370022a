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
pub use config::{Architecture, Init, TensorSpec, TransformerConfig};
pub use forward::{Forward, ForwardError};
pub(crate) use network::Reader;
pub use network::Transformer;
#[cfg(feature = "autodiff")]
pub(crate) use network::gradients_of;
pub use packed::PackedForward;
pub use predictor::BurnForward;
pub(crate) use predictor::check;
pub use weights::{Weights, WeightsError};
