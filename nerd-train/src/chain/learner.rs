//! Updates of a chain's network as a [`Learner`], so that its runs are ordinary runs.

use std::sync::{Arc, Mutex, PoisonError};

use nerd_model::chain::Chain;
use nerd_model::program::cpu::{Loaded, Memory};
use rayon::prelude::*;

use super::course::{ASTRAY, BETA, Course};
use super::draw::{Draw, draws};
use super::judge::missed;
use super::loss::Loss;
use super::unroll::{Rollout, Unroll};
use crate::learner::{LearnError, Learner, LearnerConfig, LearnerState, Progress, optimiser};
use crate::ranks::Ranks;
use crate::windows::Windows;

/// Rollouts of a thread's pass: their activations in a frame stay near the processor.
pub(crate) const ROLLOUTS: usize = 8;

/// Trains a chain's network on motions.
pub struct ChainLearner {
    chain: Chain,
    config: LearnerConfig,
    state: LearnerState,
    course: Course,
    network: Loaded,
    loss: Loss,
    /// Of this rank, where the last update ended. A resumed run restarts all of them.
    rollouts: Vec<Option<Rollout>>,
    ranks: Arc<Ranks>,
    memory: Mutex<Vec<Vec<Memory>>>,
    sums: (f64, f64, u32),
}

impl ChainLearner {
    /// Continues `state`.
    ///
    /// # Errors
    /// If no motion is as long as a rollout.
    pub fn new(chain: Chain, config: LearnerConfig, state: LearnerState, course: Course) -> Result<Self, LearnError> {
        config.check().map_err(LearnError::Mismatch)?;
        course.check()?;
        let network = Loaded::new(state.weights.config.program(), &state.weights.flat);
        let loss = Loss::new(&course.scale, course.velocity, course.frames);
        let (rollouts, memory, ranks) = (vec![None; config.batch], Mutex::default(), Arc::default());
        Ok(Self { chain, config, state, course, network, loss, rollouts, ranks, memory, sums: (0.0, 0.0, 0) })
    }

    /// Computes this rank's rollouts of every update.
    pub fn among(mut self, ranks: &Arc<Ranks>) -> Self {
        self.rollouts = vec![None; ranks.part(self.config.batch).len()];
        self.ranks = ranks.clone();
        self
    }

    /// What rollouts go through.
    fn unroll(&self) -> Unroll<'_> {
        let Self { chain, course, network, loss, .. } = self;
        Unroll { chain, motions: &course.train, network, scale: &course.scale, frames: course.frames, loss: *loss }
    }

    /// This rank's of an update: carried on, or begun where its draws say.
    fn drawn(&mut self) -> Vec<Rollout> {
        let Course { train, frames, .. } = self.course.clone();
        let total = train.frames;
        let draws = draws(&self.chain, &train, frames, self.config.seed, self.state.step, self.ranks.part(self.config.batch));
        let (before, unroll) = (std::mem::take(&mut self.rollouts), self.unroll());
        let one = |(before, draw): (Option<Rollout>, Draw)| {
            let kept = before.filter(|r| !draw.anew && r.frame + frames <= total);
            kept.unwrap_or_else(|| unroll.begin(draw.motion, draw.frame, draw.view))
        };
        before.into_iter().zip(draws).map(one).collect()
    }

    /// Whether a rollout is near enough to the truth to be carried on.
    fn near(&self, rollout: &Rollout) -> bool {
        let truth = self.unroll().begin(rollout.motion, rollout.frame, rollout.view).rods;
        let pairs = self.chain.nodes(&rollout.rods)[0].clone().into_iter().zip(self.chain.nodes(&truth)[0].clone());
        rollout.rods.finite() && pairs.map(|(a, b)| (a - b).norm()).sum::<f64>() <= ASTRAY * self.chain.rods as f64
    }
}

impl Learner for ChainLearner {
    fn update(&mut self, lr: f32) -> Result<(), LearnError> {
        let (step, mut rollouts) = (self.state.step, self.drawn());
        self.network.load(&self.state.weights.flat);
        let (unroll, weight) = (self.unroll(), 1.0 / (self.config.batch * self.course.frames) as f64);
        let part = |rollouts: &mut [Rollout]| {
            let taken = self.memory.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let mut memory = taken.unwrap_or_default();
            let done = unroll.pass(rollouts, weight, &mut memory);
            self.memory.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
            done
        };
        let parts: Vec<(f64, Vec<f32>)> = rollouts.par_chunks_mut(ROLLOUTS).map(part).collect();
        let loss = parts.iter().map(|part| part.0).sum::<f64>();
        // Added up in order: the same bits on any number of threads.
        let mut gradient = vec![0.0; self.state.weights.flat.len()];
        parts.iter().for_each(|part| gradient.iter_mut().zip(&part.1).for_each(|(sum, g)| *sum += g));
        let loss = self.ranks.sum_with(&mut gradient, loss as f32)?;
        let norm = optimiser::norm(&gradient);
        if !loss.is_finite() || !norm.is_finite() {
            return Err(LearnError::NotFinite { step, loss });
        }
        // Single frames are learned from the truth alone.
        self.rollouts = rollouts.into_par_iter().map(|r| (self.course.frames > 1 && self.near(&r)).then_some(r)).collect();
        optimiser::step_by(BETA, &mut self.state, &gradient, norm, lr, &self.config);
        self.sums = (self.sums.0 + f64::from(loss), self.sums.1 + f64::from(norm), self.sums.2 + 1);
        Ok(())
    }

    fn replace(&mut self, _: usize, _: &Windows) -> Result<(), LearnError> {
        Err(LearnError::Mismatch("a chain learns from motions, no windows can take their places".into()))
    }

    fn progress(&mut self) -> Result<Progress, LearnError> {
        let (loss, norm, n) = std::mem::take(&mut self.sums);
        let n = f64::from(n.max(1));
        Ok(Progress { loss: (loss / n) as f32, gradient_norm: (norm / n) as f32 })
    }

    /// What the averaged weights miss of the change of rates in single frames, as a share of it.
    fn validate(&mut self, frames: usize) -> Result<f32, LearnError> {
        self.network.load(&self.state.average);
        Ok(missed(&self.chain, &self.course.validation, &self.network, &self.course.scale, frames) as f32)
    }

    fn state(&mut self) -> Result<LearnerState, LearnError> {
        Ok(self.state.clone())
    }
}
