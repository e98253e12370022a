//! Learned dynamics: features, normaliser, causal Transformer, the `Neural` solver and model folders.

pub mod transformer;
