//! One horizon of steps under a policy, and what the update learns from it.

use nerd_tasks::StepResult;

use super::*;

/// Steps `[step][env]` of one iteration.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    /// Stacked observations.
    pub observations: Vec<f64>,
    /// Actions as drawn; environments clamp them.
    pub actions: Vec<f32>,
    /// Mean actions.
    pub mean: Vec<f32>,
    /// Logarithms of the spread.
    pub spread: Vec<f32>,
    /// Minus logarithms of the actions' probabilities.
    pub surprise: Vec<f32>,
    /// Values, in units of reward.
    pub values: Vec<f64>,
    /// Advantages, in units of reward.
    pub advantages: Vec<f64>,
}

impl Rollout {
    /// Forgets all steps, and keeps their memory for the next ones.
    pub(super) fn clear(&mut self) {
        let Self { observations, actions, mean, spread, surprise, values, advantages } = self;
        [observations, values, advantages].into_iter().for_each(Vec::clear);
        [actions, mean, spread, surprise].into_iter().for_each(Vec::clear);
    }
}

/// An episode that ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ended {
    /// Step of the rollout in which it did.
    pub step: usize,
    /// Its environment.
    pub env: usize,
    /// Sum of its rewards.
    pub total: f64,
    /// Its steps.
    pub length: f64,
}

/// How a rollout went.
#[derive(Clone, Debug, Default)]
pub struct Taken {
    /// Episodes that ended, in order.
    pub ended: Vec<Ended>,
    /// Episodes that the solver could not go on with, or that were broken off for a frame without slopes.
    pub failed: usize,
    /// Sums of [`nerd_tasks::Task::terms`] over all steps; empty where they are made on a GPU.
    pub terms: Vec<f64>,
}

/// Episodes under way.
#[derive(Clone, Debug, PartialEq)]
pub struct Running {
    /// Stacked observations.
    pub stack: Stack,
    /// Sum of rewards so far, by environment.
    pub rewards: Vec<f64>,
    /// Steps so far, by environment.
    pub lengths: Vec<f64>,
}

impl Running {
    /// Episodes that have just started.
    pub fn new(episodes: &Episodes, stack: usize) -> Self {
        let n = episodes.len();
        let stack = Stack::new(stack, episodes.task.observation_dim(), episodes.observations());
        Self { stack, rewards: vec![0.0; n], lengths: vec![0.0; n] }
    }

    /// One step: what the task says of it, and episodes that ended, as in step 0. `out` gets the stacked observations that were reached where
    /// time ran out.
    pub fn step(&mut self, episodes: &mut Episodes, actions: &[f64], out: &mut Vec<f64>) -> Result<(StepResult, Vec<Ended>), StepError> {
        let result = episodes.step(actions)?;
        let over = |env: usize| result.terminated[env] || result.truncated[env];
        let ended = (0..self.rewards.len()).filter_map(|env| self.count(0, env, result.rewards[env], over(env))).collect();
        let cut: Vec<usize> = (0..self.rewards.len()).filter(|env| result.truncated[*env]).collect();
        self.stack.push(&result.reached, &cut, over, episodes.observations(), out);
        Ok((result, ended))
    }

    /// Breaks off an environment's episode, which counts for nothing, and begins the next one.
    pub(super) fn begin(&mut self, episodes: &mut Episodes, env: usize) {
        episodes.begin(env);
        (self.rewards[env], self.lengths[env]) = (0.0, 0.0);
        self.stack.begin(|other| other == env, episodes.observations());
    }

    /// Takes the reward of a step in; the episode, if it is over.
    pub(super) fn count(&mut self, step: usize, env: usize, reward: f64, over: bool) -> Option<Ended> {
        self.rewards[env] += reward;
        self.lengths[env] += 1.0;
        over.then(|| {
            let [total, length] = [&mut self.rewards, &mut self.lengths].map(|of| std::mem::take(&mut of[env]));
            Ended { step, env, total, length }
        })
    }
}
