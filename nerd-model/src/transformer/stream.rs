//! Frame-by-frame evaluation of a network, and an adapter for engines that evaluate windows.

use super::forward::{Forward, ForwardError, ForwardResult};
use crate::program::config::TransformerConfig;

/// Evaluates a network one frame at a time, with memory of earlier frames.
///
/// Predictions equal those of the training pass over all frames since the environment was cleared.
pub trait Stream: Send {
    /// Evaluates one frame of every environment. `tokens` is `[env][inputs]`, normalised, row-major. Predictions in
    /// normalised target units replace `out`: `[env][outputs]`. The number of environments must not change.
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> ForwardResult;

    /// Clears the memory of one environment.
    fn clear(&mut self, env: usize);
}

/// A [`Stream`] that stores the tokens that a prediction depends on ([`TransformerConfig::reach`]) and evaluates them
/// as windows.
pub struct Windowed<F> {
    forward: F,
    config: TransformerConfig,
    /// Stored tokens, `[env][reach][inputs]`, oldest first.
    tokens: Vec<f32>,
    /// Number of stored tokens of each environment.
    held: Vec<usize>,
    window: Vec<f32>,
    last: Vec<u32>,
}

impl<F: Forward> Windowed<F> {
    /// A stream evaluated by `forward`.
    pub fn new(forward: F, config: TransformerConfig) -> Self {
        Self { forward, config, tokens: Vec::new(), held: Vec::new(), window: Vec::new(), last: Vec::new() }
    }

    fn remember(&mut self, env: usize, token: &[f32]) {
        let h = self.config.reach();
        let width = self.config.inputs;
        let past = &mut self.tokens[env * h * width..(env + 1) * h * width];
        if self.held[env] == h {
            past.copy_within(width.., 0);
            self.held[env] -= 1;
        }
        past[self.held[env] * width..][..width].copy_from_slice(token);
        self.held[env] += 1;
    }
}

impl<F: Forward> Stream for Windowed<F> {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> ForwardResult {
        let h = self.config.reach();
        let width = self.config.inputs;
        let envs = check(&self.config, tokens)?;
        self.tokens.resize(envs * h * width, 0.0);
        self.held.resize(envs, 0);
        tokens.chunks_exact(width).enumerate().for_each(|(env, token)| self.remember(env, token));
        out.clear();
        // Shorter windows are padded after their newest token, which a causal network cannot see.
        let Some(longest) = self.held.iter().copied().max() else { return Ok(()) };
        self.window.clear();
        self.last.clear();
        for past in self.tokens.chunks_exact(h * width) {
            self.window.extend_from_slice(&past[..longest * width]);
        }
        self.last.extend(self.held.iter().map(|held| *held as u32 - 1));
        self.forward.forward(&self.window, longest, &self.last, out)
    }

    fn clear(&mut self, env: usize) {
        if let Some(held) = self.held.get_mut(env) {
            *held = 0;
        }
    }
}

/// Refuses frames that do not fit the network; returns the number of environments.
pub(super) fn check(config: &TransformerConfig, tokens: &[f32]) -> ForwardResult<usize> {
    let envs = tokens.len() / config.inputs;
    if envs * config.inputs != tokens.len() {
        return Err(ForwardError {
            message: format!("{} input values are not rows of {}", tokens.len(), config.inputs),
        });
    }
    Ok(envs)
}
