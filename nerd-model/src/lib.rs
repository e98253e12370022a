//! Learned dynamics: features, normaliser, causal Transformer (and the networks it is compared with), the `Neural` solver and
//! model folders.

pub mod base;
pub mod features;
pub mod folder;
pub mod form;
mod frame;
pub mod mlp;
pub mod network;
pub mod neural;
pub mod normalizer;
pub mod pick;
pub mod recurrent;
pub mod transformer;

/// Where burn computes: `BurnDevice::flex()`, the CPU.
pub use burn::tensor::Device as BurnDevice;
