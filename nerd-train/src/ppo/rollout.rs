//! One horizon of steps under a policy, and the data its update needs.

use nerd_tasks::StepResult;

use super::*;

/// Steps of one iteration, `[step][env]`.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    /// Stacked observations `[step][env][inputs]`.
    pub observations: Vec<f64>,
    /// Sampled actions `[step][env][action]`; environments clamp them to [-1, 1].
    pub actions: Vec<f32>,
    /// Mean actions `[step][env][action]`.
    pub mean: Vec<f32>,
    /// Log standard deviations of actions `[step][env][action]`.
    pub spread: Vec<f32>,
    /// Negative log-probabilities of the sampled actions `[step][env]`.
    pub neg_log_prob: Vec<f32>,
    /// Values of the states before each step `[step][env]` (units of reward).
    pub values: Vec<f64>,
    /// Advantages `[step][env]` (units of reward).
    pub advantages: Vec<f64>,
}

impl Rollout {
    /// Clears all steps and keeps the allocations.
    pub(super) fn clear(&mut self) {
        let Self { observations, actions, mean, spread, neg_log_prob, values, advantages } = self;
        [observations, values, advantages].into_iter().for_each(Vec::clear);
        [actions, mean, spread, neg_log_prob].into_iter().for_each(Vec::clear);
    }
}

/// An episode that ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ended {
    /// Step of the rollout that ended the episode, from 0.
    pub step: usize,
    /// Index of the environment.
    pub env: usize,
    /// Return: sum of rewards.
    pub total: f64,
    /// Length of the episode (steps).
    pub length: f64,
}

/// Result of a rollout.
#[derive(Clone, Debug, Default)]
pub struct RolloutStats {
    /// Episodes that ended, in order of step and environment.
    pub ended: Vec<Ended>,
    /// Number of episodes that a solver failure ended, or that broke off at a frame without finite gradients.
    pub failed: usize,
    /// Sums of [`nerd_tasks::Task::terms`] over all steps; empty for rollouts on a GPU.
    pub terms: Vec<f64>,
}

/// Running episodes of all environments.
#[derive(Clone, Debug, PartialEq)]
pub struct Running {
    /// Stacked observations of all environments.
    pub stack: Stack,
    /// Sum of rewards so far, by environment.
    pub rewards: Vec<f64>,
    /// Steps so far, by environment.
    pub lengths: Vec<f64>,
}

impl Running {
    /// State of all episodes at their start, with `stack` stacked observations.
    pub fn new(episodes: &Episodes, stack: usize) -> Self {
        let n = episodes.len();
        let stack = Stack::new(stack, episodes.task.observation_dim(), episodes.observations());
        Self { stack, rewards: vec![0.0; n], lengths: vec![0.0; n] }
    }

    /// Steps all environments. Returns the task's results and the ended episodes; the caller must set `step` in these,
    /// which is 0. `out` receives the stacked final observations of truncated episodes, in order of environment.
    pub fn step(
        &mut self,
        episodes: &mut Episodes,
        actions: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<(StepResult, Vec<Ended>), StepError> {
        let result = episodes.step(actions)?;
        let over = |env: usize| result.terminated[env] || result.truncated[env];
        let ended =
            (0..self.rewards.len()).filter_map(|env| self.count(0, env, result.rewards[env], over(env))).collect();
        let cut = (0..self.rewards.len()).filter(|env| result.truncated[*env]).collect_vec();
        self.stack.push(&result.reached, &cut, over, episodes.observations(), out);
        Ok((result, ended))
    }

    /// Breaks off the episode of an environment, without counting it, and begins the next.
    pub(super) fn begin(&mut self, episodes: &mut Episodes, env: usize) {
        episodes.begin(env);
        (self.rewards[env], self.lengths[env]) = (0.0, 0.0);
        self.stack.begin(|other| other == env, episodes.observations());
    }

    /// Adds the reward of one step of an environment; returns the environment's episode if it is `over`.
    pub(super) fn count(&mut self, step: usize, env: usize, reward: f64, over: bool) -> Option<Ended> {
        self.rewards[env] += reward;
        self.lengths[env] += 1.0;
        over.then(|| {
            let [total, length] = [&mut self.rewards, &mut self.lengths].map(|of| std::mem::take(&mut of[env]));
            Ended { step, env, total, length }
        })
    }
}
