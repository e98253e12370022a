//! Training on measured trajectories with a loss over many predicted frames.
//!
//! One measured frame says little: noise on it drowns what a model could learn. So a rollout is made from a measured state in the model
//! as it is, and every prediction in it is moved to where the whole rollout comes nearer to the measurement (the adjoint method, see
//! `adjoint.rs`). The usual learner then takes a step towards these targets, whose squared error has that very gradient.

mod adjoint;
mod chosen;
mod single;
mod tangent;

use std::sync::Arc;

use nerd_model::folder::Model;
use nerd_sim::calibrate::{Distance, Subject, Trial, mean, objective};
use nerd_sim::sampling::stream;
use rand::RngExt;

pub use adjoint::{Slope, slope};
pub use chosen::Worth;
pub use single::{SmallModel, silence, single, solver};

use chosen::Chosen;

use crate::error::{Result, refuse};
use crate::learner::{CpuLearner, Learner, LearnerConfig, LearnerState, Optimizer};
use crate::schedule::Schedule;

/// How to train.
#[derive(Clone, Copy, Debug)]
pub struct UnrollConfig {
    /// Updates.
    pub updates: u64,
    /// Rollouts in an update.
    pub batch: usize,
    /// Learning rate of the first update; it falls to zero in a straight line.
    pub rate: f64,
    /// Updates between validations.
    pub validate_every: u64,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for UnrollConfig {
    fn default() -> Self {
        Self { updates: 400, batch: 48, rate: 1e-3, validate_every: 40, seed: 0 }
    }
}

/// A model that learns the motion of a subject from trials of it.
pub struct Unroll<'a> {
    /// What was measured, its robot calibrated or not.
    pub subject: &'a Subject,
    /// What is trained on: rollouts of as many frames as the network's sequence has.
    pub train: &'a [Trial],
    /// What the best weights are chosen by, of any length.
    pub validation: &'a [Trial],
    /// Units of the errors.
    pub unit: Distance,
}

impl UnrollConfig {
    /// Refuses what nothing can be trained by.
    fn check(&self) -> Result<()> {
        if self.batch == 0 || self.validate_every == 0 {
            refuse!("`batch` and `validate_every` must be at least 1; they are {} and {}", self.batch, self.validate_every);
        }
        Ok(())
    }
}

impl Unroll<'_> {
    /// Trains a model; its best weights by the validation trials, those at the start among them, and the objective there.
    /// `progress` is told updates done, the error on what is trained on, and the best objective so far.
    ///
    /// # Errors
    /// A network with a memory, trials of other lengths, rollouts that end in no number.
    pub fn train(&self, model: &Model, config: UnrollConfig, progress: &mut dyn FnMut(u64, f64, f64)) -> Result<(Model, f64)> {
        let (network, frames) = (model.config.network, model.config.network.sequence());
        if network.history != 1 {
            refuse!("a network with a history of {}: unrolling takes one that sees a frame alone", network.history);
        }
        if let Some(trial) = self.train.iter().find(|t| t.torques.len() != frames) {
            refuse!("a rollout of {} frames among those of {frames} that the network's sequence has", trial.torques.len());
        }
        if self.train.is_empty() || self.validation.is_empty() {
            refuse!("nothing to train on, or nothing to choose by");
        }
        config.check()?;
        let mut rng = stream(config.seed, 0);
        let judge = |model: &Model| self.worth(model);
        let mut chosen = Chosen::new(model, &judge)?;
        let mut now = model.clone();
        let settings =
            LearnerConfig { batch: config.batch, clip: 1.0, average: 0.98, seed: config.seed, huber: None, optimizer: Optimizer::Adam };
        let schedule = Schedule { start: config.rate, end: 0.0, ..Schedule::default() };
        // Every rollout of an update counts once.
        let rows: Vec<u64> = (0..config.batch as u64).collect();
        let mut learner: Option<CpuLearner> = None;
        for step in 0..config.updates {
            let drawn: Vec<Trial> = (0..config.batch).map(|_| self.train[rng.random_range(0..self.train.len())].clone()).collect();
            let slope = slope(&now, self.subject, &drawn, &self.unit)?;
            let (error, windows) = (slope.error, slope.targets());
            let learner = match &mut learner {
                Some(learner) => {
                    learner.replace(0, &windows)?;
                    learner
                }
                empty => {
                    let windows = Arc::new(windows);
                    empty.insert(CpuLearner::new(settings, LearnerState::new(now.weights.clone()), windows.clone(), windows)?)
                }
            };
            learner.update_on(schedule.rate(step, config.updates) as f32, &rows)?;
            now.weights = learner.state()?.weights;
            chosen.look(step + 1, &config, learner)?;
            progress(step + 1, error, chosen.worth);
        }
        Ok(chosen.best())
    }

    /// The objective of a model on the validation trials.
    fn worth(&self, model: &Model) -> Result<f64> {
        Ok(objective(&mean(&distances(model, self.subject, self.validation)?), &self.unit))
    }
}

/// How far a model's rollouts are from trials.
///
/// # Errors
/// What the solver says.
pub fn distances(model: &Model, subject: &Subject, trials: &[Trial]) -> Result<Vec<Distance>> {
    Ok(subject.distances_in(trials, &solver(model, &subject.system))?)
}
