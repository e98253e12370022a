//! What a learned solver asks of a network, whoever evaluates it.

/// Evaluates a network on windows; what computes it is the implementer's business.
pub trait Forward: Send {
    /// Predictions at the newest token of each window, in normalised target units.
    ///
    /// `inputs` is `[windows][tokens][inputs]`, normalised, row-major, the oldest token first; `last[w]` is the index
    /// of the newest token of window `w`, and the tokens behind it are padding of any finite value. `out` is
    /// replaced by `[windows][outputs]`.
    ///
    /// # Errors
    /// If the lengths do not fit the network, or the device fails.
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError>;
}

/// Why a network could not be evaluated.
#[derive(Debug, thiserror::Error)]
#[error("network: {message}")]
pub struct ForwardError {
    /// What went wrong.
    pub message: String,
}
