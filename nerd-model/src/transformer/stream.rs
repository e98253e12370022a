//! The frame-by-frame interface of a network, and an adapter for engines of whole windows.

use super::forward::{Forward, ForwardError};
use crate::program::config::TransformerConfig;

/// Evaluates a network one frame at a time, with memory of earlier frames.
///
/// A prediction equals the training pass's over all frames since the environment was cleared.
pub trait Stream: Send {
    /// One frame of every environment. `tokens` is `[env][inputs]`, normalised, row-major; predictions, in normalised target units, replace
    /// `out`: `[env][outputs]`. Every call has the same number of environments.
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError>;

    /// Forgets the frames of one environment.
    fn clear(&mut self, env: usize);

    /// Memory of one environment as numbers; a network that sees one frame has none, and is never asked.
    fn remembered(&self, _env: usize) -> Result<Vec<f64>, ForwardError> {
        Ok(Vec::new())
    }

    /// Restores an environment's memory from the [`Self::remembered`] numbers of another. The environment has stepped at least once.
    fn recall(&mut self, env: usize, _memory: &[f64]) -> Result<(), ForwardError> {
        self.clear(env);
        Ok(())
    }
}

/// A [`Stream`] that keeps the tokens on which a prediction depends ([`TransformerConfig::reach`]) and evaluates them as windows.
pub struct Windowed<F> {
    forward: F,
    config: TransformerConfig,
    /// `[env][reach][inputs]`, oldest first.
    tokens: Vec<f32>,
    /// Tokens held of each environment.
    held: Vec<usize>,
    window: Vec<f32>,
    last: Vec<u32>,
}

impl<F: Forward> Windowed<F> {
    /// Evaluated by `forward`.
    pub fn new(forward: F, config: TransformerConfig) -> Self {
        Self { forward, config, tokens: Vec::new(), held: Vec::new(), window: Vec::new(), last: Vec::new() }
    }

    fn remember(&mut self, env: usize, token: &[f32]) {
        let (h, width) = (self.config.reach(), self.config.inputs);
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
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        let (h, width) = (self.config.reach(), self.config.inputs);
        let envs = check(&self.config, tokens)?;
        self.tokens.resize(envs * h * width, 0.0);
        self.held.resize(envs, 0);
        tokens.chunks_exact(width).enumerate().for_each(|(env, token)| self.remember(env, token));
        out.clear();
        // Windows shorter than the longest are padded after their newest token, which a causal network cannot see.
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

    fn remembered(&self, env: usize) -> Result<Vec<f64>, ForwardError> {
        let (row, width) = (self.config.reach() * self.config.inputs, self.config.inputs);
        let held = self.held.get(env).map_or(&[][..], |held| &self.tokens[env * row..][..held * width]);
        Ok(held.iter().map(|x| f64::from(*x)).collect())
    }

    fn recall(&mut self, env: usize, memory: &[f64]) -> Result<(), ForwardError> {
        let (reach, width) = (self.config.reach(), self.config.inputs);
        if !memory.len().is_multiple_of(width) || memory.len() > reach * width || env >= self.held.len() {
            return Err(ForwardError { message: format!("{} numbers are no memory of environment {env}", memory.len()) });
        }
        self.tokens[env * reach * width..].iter_mut().zip(memory).for_each(|(token, x)| *token = *x as f32);
        self.held[env] = memory.len() / width;
        Ok(())
    }
}

/// Refuses frames that do not fit a network; returns the number of environments.
pub(super) fn check(config: &TransformerConfig, tokens: &[f32]) -> Result<usize, ForwardError> {
    let envs = tokens.len() / config.inputs;
    if envs * config.inputs != tokens.len() {
        return Err(ForwardError { message: format!("{} input values are not rows of {}", tokens.len(), config.inputs) });
    }
    Ok(envs)
}
