//! Data from the states that a model comes to by itself (DAgger: Ross, Gordon and Bagnell 2011): what a loss over many predicted
//! frames teaches, without gradients through the rollout.
//!
//! The model steps, so tokens hold its own states and the contacts found there; targets lead to where the truth goes from them.

use std::sync::Arc;

use nerd_sim::prelude::*;

/// Makes the models that step.
pub type Own = Arc<dyn Fn() -> Box<dyn Solver> + Send + Sync>;

/// Whether shard k is one of a model's own, so that their share is kept at every length.
pub fn is_own(k: u64, share: f64) -> bool {
    ((k + 1) as f64 * share).floor() > (k as f64 * share).floor()
}

/// Steps as a model does, and keeps where the truth would have gone.
pub struct Judged {
    model: Box<dyn Solver>,
    truth: Box<dyn Solver>,
    there: Option<Batch>,
    /// States `[frame][env][q, qd]` that the truth came to from the model's.
    pub truths: Vec<f32>,
}

impl Judged {
    /// A model, and what it is held against.
    pub fn new(model: Box<dyn Solver>, truth: Box<dyn Solver>) -> Self {
        Self { model, truth, there: None, truths: Vec::new() }
    }
}

impl Solver for Judged {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let there = self.there.get_or_insert_with(|| batch.clone());
        there.clone_from(batch);
        (0..there.len()).for_each(|env| self.truth.reset(env));
        self.truth.step(there, torques)?;
        self.truths.extend(there.states.iter().map(|x| *x as f32));
        self.model.step(batch, torques)
    }

    fn reset(&mut self, env: usize) {
        self.model.reset(env);
        self.truth.reset(env);
    }
}
