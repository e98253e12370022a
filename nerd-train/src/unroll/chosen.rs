//! The best of the weights that a training meets.

use nerd_model::folder::Model;
use nerd_model::transformer::Weights;

use super::UnrollConfig;
use crate::error::Result;
use crate::learner::Learner;

/// What tells how good a model is: the smaller, the better.
pub type Worth<'a> = dyn Fn(&Model) -> Result<f64> + Sync + 'a;

/// The best weights so far, those at the start among them.
pub struct Chosen<'a> {
    model: Model,
    /// What they are worth.
    pub worth: f64,
    judge: &'a Worth<'a>,
}

impl<'a> Chosen<'a> {
    /// Before anything is learned.
    pub fn new(model: &Model, judge: &'a Worth<'a>) -> Result<Self> {
        Ok(Self { model: model.clone(), worth: judge(model)?, judge })
    }

    /// Looks at the averaged weights after so many updates, if this is when.
    pub fn look(&mut self, done: u64, config: &UnrollConfig, learner: &mut dyn Learner) -> Result<()> {
        if !done.is_multiple_of(config.validate_every) && done != config.updates {
            return Ok(());
        }
        let weights = Weights { config: self.model.config.network, flat: learner.state()?.average };
        let model = Model { weights, ..self.model.clone() };
        let worth = (self.judge)(&model)?;
        if worth < self.worth {
            (self.model, self.worth) = (model, worth);
        }
        Ok(())
    }

    /// Them, and what they are worth.
    pub fn best(self) -> (Model, f64) {
        (self.model, self.worth)
    }
}
