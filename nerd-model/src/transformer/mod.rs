//! The causal Transformer.

mod attention;
mod block;
mod config;
pub mod elementwise;
mod forward;
mod network;
mod packed;
mod places;
mod predictor;
mod stream;
mod weights;

pub use attention::Attention;
pub use block::Block;
pub use config::{Architecture, Init, MOST_PARAMETERS, Positions, TensorSpec, TransformerConfig};
pub use forward::{Forward, ForwardError};
pub(crate) use network::Reader;
pub use network::Transformer;
#[cfg(feature = "autodiff")]
pub(crate) use network::gradients_of;
pub use packed::{PackedForward, PackedStream, packed};
pub use places::Places;
pub use predictor::BurnForward;
pub(crate) use predictor::check;
pub use stream::{Stream, Windowed};
pub use weights::{Storage, Weights, WeightsError};
