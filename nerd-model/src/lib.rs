//! Learned dynamics: features, normaliser, causal Transformer, the `Neural` solver and model folders.

pub mod base;
pub mod features;
pub mod folder;
mod frame;
pub mod neural;
pub mod normalizer;
pub mod pick;
pub mod transformer;

/// Where burn computes: `BurnDevice::flex()`, the CPU.
pub use burn::tensor::Device as BurnDevice;
