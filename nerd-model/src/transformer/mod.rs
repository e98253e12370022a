//! The causal Transformer.

mod config;
mod weights;

pub use config::{Init, TensorSpec, TransformerConfig};
pub use weights::{Weights, WeightsError};
