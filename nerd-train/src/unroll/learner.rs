//! Training through many frames as a [`Learner`], for ordinary runs.

use super::course::Draw;
use super::*;
use crate::learner::optimiser::Optimiser;

/// Rollouts per pass of a thread, few enough that the activations of a frame stay in cache.
pub(crate) const ROLLOUTS: usize = 8;

/// Trains a network on motions.
pub struct UnrollLearner<B: Body> {
    optimiser: Optimiser,
    course: Course<B>,
    network: Loaded,
    /// Rollouts that the next update may continue; `None` for one that must restart. A resumed run restarts all
    /// rollouts.
    rollouts: Vec<Option<Rollout<B>>>,
    memory: Mutex<Vec<Vec<Memory>>>,
}

impl<B: Body> UnrollLearner<B> {
    /// Continues training from `state`.
    ///
    /// # Errors
    /// If motions are shorter than a rollout.
    pub fn new(config: LearnerConfig, state: LearnerState, course: Course<B>) -> LearnResult<Self> {
        config.check()?;
        course.check()?;
        let network = Loaded::new(state.weights.config.program(), &state.weights.flat);
        let rollouts = vec![None; config.batch];
        let optimiser = Optimiser::new(config, state, BETA);
        Ok(Self { optimiser, course, network, rollouts, memory: Mutex::default() })
    }

    fn unroll(&self) -> Unroll<'_, B> {
        Unroll { course: &self.course, network: &self.network }
    }

    /// Rollouts of the next update: continued from the last update, or restarted at a random place.
    fn drawn(&mut self) -> Vec<Rollout<B>> {
        let frames = self.course.frames;
        let total = self.course.train.frames;
        let config = self.optimiser.config;
        let draws = self.course.draws(config.seed, self.optimiser.state.step, config.batch);
        let mut before = std::mem::take(&mut self.rollouts);
        // A failed update leaves no rollouts.
        before.resize(draws.len(), None);
        let unroll = self.unroll();
        let one = |(before, draw): (Option<Rollout<B>>, Draw<B::View>)| {
            let kept = before.filter(|r| !draw.anew && r.place.frame + frames <= total);
            kept.unwrap_or_else(|| unroll.begin(draw.place))
        };
        before.into_iter().zip(draws).map(one).collect()
    }

    /// Whether a rollout is close enough to the truth to continue.
    fn near(&self, rollout: &Rollout<B>) -> bool {
        self.course.body.near(&rollout.state, &self.unroll().begin(rollout.place).state)
    }
}

impl<B: Body> Learner for UnrollLearner<B> {
    fn update(&mut self, lr: f32) -> LearnResult {
        let mut rollouts = self.drawn();
        self.network.load(&self.optimiser.state.weights.flat);
        let unroll = self.unroll();
        let weight = 1.0 / (self.optimiser.config.batch * self.course.frames) as f64;
        let part = |rollouts: &mut [Rollout<B>]| {
            let taken = self.memory.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let mut memory = taken.unwrap_or_default();
            let done = unroll.pass(rollouts, weight, &mut memory);
            self.memory.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
            done
        };
        let parts: Vec<(f64, Vec<f32>)> = rollouts.par_chunks_mut(ROLLOUTS).map(part).collect();
        let loss = parts.iter().map(|part| part.0).sum::<f64>();
        // Sum in order, so that the bits do not depend on the number of threads.
        let mut gradient = vec![0.0; self.optimiser.state.weights.flat.len()];
        parts.iter().for_each(|part| add(&mut gradient, &part.1));
        self.optimiser.update(lr, loss as f32, &gradient)?;
        // Rollouts of one frame always start from the truth.
        let carried = self.course.frames > 1;
        self.rollouts = rollouts.into_par_iter().map(|r| (carried && self.near(&r)).then_some(r)).collect();
        Ok(())
    }

    fn progress(&mut self) -> LearnResult<Progress> {
        Ok(self.optimiser.progress())
    }

    /// Error of predictions by the averaged weights after one frame, relative to the true change over the frame.
    fn validate(&mut self, frames: usize) -> LearnResult<f32> {
        self.network.load(&self.optimiser.state.average);
        Ok(self.course.body.missed(&self.course.validation, &self.network, frames) as f32)
    }

    fn state(&mut self) -> LearnResult<LearnerState> {
        Ok(self.optimiser.state.clone())
    }
}
