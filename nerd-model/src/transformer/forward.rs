//! The interface between a learned solver and the engine of its network.

use crate::program::config::{Positions, TransformerConfig};

/// Evaluates a network on windows; what computes it is the implementer's business.
pub trait Forward: Send {
    /// Predictions at the newest token of each window, in normalised target units.
    ///
    /// `inputs` is `[windows][tokens][inputs]`, normalised, row-major, the oldest token first; `last[w]` is the index
    /// of the newest token of window `w`, and later tokens are padding of any finite value. `out` is
    /// replaced by `[windows][outputs]`.
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError>;
}

/// Why a network could not be evaluated.
#[derive(Debug, thiserror::Error)]
#[error("network: {message}")]
pub struct ForwardError {
    /// What went wrong.
    pub message: String,
}

/// Refuses windows that do not fit a network.
pub(crate) fn check(config: &TransformerConfig, inputs: &[f32], tokens: usize, last: &[u32]) -> Result<(), ForwardError> {
    let expected = last.len() * tokens * config.inputs;
    let message = if tokens == 0 || (config.positions == Positions::Table && tokens > config.block) {
        format!("{tokens} tokens in a window, the position table has {}", config.block)
    } else if inputs.len() != expected {
        format!("{} input values, expected {} windows x {tokens} tokens x {} = {expected}", inputs.len(), last.len(), config.inputs)
    } else if let Some(w) = last.iter().position(|&l| l as usize >= tokens) {
        format!("window {w}: newest token {} of {tokens}", last[w])
    } else {
        return Ok(());
    };
    Err(ForwardError { message })
}
