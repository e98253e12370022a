//! Short-horizon actor-critic (Xu et al. 2022, arXiv 2204.07137): the policy ascends the gradient of its return,
//! found by backpropagation through its rollouts.
//!
//! ```text
//! J = 1 / (N h) sum_env [ sum_t c_t R_t + c_h V'(s_h) ]      c = 1, gamma, gamma^2, .. from the window's or an episode's start
//! ```
//!
//! Actions are `clamp(mu + exp(s) noise)` with the noise held, so J is a function of the policy; `back.rs` has its gradient, through
//! observation, policy, action, solver and reward of every step. What ends an episode cuts the way back: a terminal state is worth nothing
//! more, where time ran out the critic's value stands, as at the horizon. That value is of a critic V' which follows (by 1 - 0.2 an iteration)
//! the one that learns the TD(lambda) returns under it (`critic.rs`). The rate falls in a line to a hundredth of the first.
//!
//! At an action beyond its bounds the clamp has no slope: one that leads back inside passes all the same (Hausknecht and Stone 2016), without
//! which a policy that is sure of itself never changes its mind.

mod back;
mod critic;
mod steps;
mod through;

use std::ops::Range;

use super::*;
use back::{Found, back};
use steps::Steps;
use through::{By, through};

/// Decay of Adam's moments, as in the paper.
pub(super) const BETA: [f64; 2] = [0.7, 0.95];
/// Share of the critic before that the slower one keeps in an iteration.
pub(super) const KEPT: f32 = 0.2;
/// Logarithm of the spread that a policy begins with: a wide one is clamped, where there are no slopes.
const SPREAD: f32 = -1.0;
/// Least share of the first rate.
const LEAST: f64 = 1e-2;

/// SHAC on the CPU, over any solver with slopes.
pub struct Shac {
    /// Gradient of `-J` of the last rollout by the policy's parameters.
    pub gradient: Vec<f32>,
    /// J of the last rollout.
    pub earned: f64,
    pub(super) critic: Policy,
    pub(super) adam: Adam,
    /// The weights of V'.
    pub(super) slow: Vec<f32>,
    steps: Steps,
    by_actions: Vec<f64>,
    returns: Vec<f64>,
}

impl Shac {
    /// Of a policy that has learned nothing, whose spread is narrowed; `seed` draws the critic's weights.
    ///
    /// # Errors
    /// If the task, the solver or what sensors show has no slopes.
    pub fn new(episodes: &mut Episodes, policy: &mut Policy, config: &PpoConfig, seed: u64) -> Result<Self> {
        if episodes.task.slopes().is_none() {
            refuse!(
                "task `{}` is not written in formulas (nerd_tasks::formula), so it has no slopes: train it by PPO",
                episodes.task.name()
            );
        }
        if episodes.simulation.batch.system.sensed() {
            refuse!("what a policy sees late or with noise has no slopes: leave noise and lag out of [vary], or train it by PPO");
        }
        // What a solver has no slopes of it says when it is asked.
        let Simulation { batch, solver } = &mut episodes.simulation;
        let robot = &batch.system.robot;
        let (torques, nothing) = (vec![0.0; batch.len() * robot.joint_count()], vec![0.0; batch.len() * 2 * robot.nv()]);
        if let Err(error) = solver.back(batch, &torques, 1, &nothing) {
            error.faults()?;
        }
        let spread = policy.flat.len() - policy.shape.spread();
        policy.flat[spread..].fill(SPREAD);
        let mut critic = Policy::new(policy.shape.clone(), &mut stream(seed, 0));
        // Before it has learned anything its value has no slope, where a random one would lead astray.
        let (inside, outputs) = (critic.shape.hidden.last().copied().unwrap_or(critic.shape.inputs()), critic.shape.outputs());
        critic.flat[spread - (inside + 1) * outputs..].fill(0.0);
        let (adam, slow) = (Adam::new(critic.flat.len(), config.rate), critic.flat.clone());
        let (gradient, steps, by_actions, returns) = Default::default();
        Ok(Self { gradient, earned: 0.0, critic, adam, slow, steps, by_actions, returns })
    }

    /// Sets the rates of an iteration, and makes the policy's step along the gradient; the norm of that.
    pub(super) fn climb(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, orders: StreamKey) -> f32 {
        let gradient = std::mem::take(&mut self.gradient);
        let left = (1.0 - orders.number as f64 / config.iterations as f64).max(LEAST);
        (adam.rate, self.adam.rate) = (config.rate * left, config.rate * left);
        // The critic's number of updates so far, also in a resumed run.
        self.adam.step = adam.step * (config.epochs * config.steps().div_ceil(config.minibatch)) as u64;
        adam.step(BETA, &mut policy.flat, &gradient, config.gradient_norm)
    }

    /// What an update did, by the norm of its gradient and the critic's error.
    pub(super) fn told(&self, policy: &Policy, norm: f32, critic: f64) -> Updated {
        let entropy = policy.spread().iter().map(|s| f64::from(*s) + 0.5 * (std::f64::consts::TAU.ln() + 1.0)).sum();
        let terms = Terms { actor: -self.earned, critic, entropy, ..Terms::default() };
        Updated { terms, gradient_norm: norm.into() }
    }

    /// V', with the moments of this policy.
    fn value(&self, policy: &Policy) -> Policy {
        Policy { flat: self.slow.clone(), ..policy.clone() }
    }

    /// The share of these environments in the gradient of `-J` by the policy's parameters.
    fn by_parameters(&self, policy: &Policy, envs: Range<usize>) -> Vec<f32> {
        let (width, a, n) = (policy.shape.inputs(), policy.shape.action, self.environments());
        let own: Vec<usize> = (0..self.by_actions.len() / a).filter(|i| envs.contains(&(i % n))).collect();
        let rows: Vec<f64> = own.iter().flat_map(|i| &self.steps.rows[i * width..][..width]).copied().collect();
        let by_action = |i: usize| &self.by_actions[own[i] * a..][..a];
        let (mut flat, _) = through(policy, &policy.network(), &rows, By::Parameters, |i, _, by| {
            by.iter_mut().zip(by_action(i)).for_each(|(by, g)| *by = *g as f32);
            0.0
        });
        let spread = flat.len() - a;
        for (i, k) in own.iter().enumerate().flat_map(|(i, _)| (0..a).map(move |k| (i, k))) {
            let noise = self.steps.drawn[own[i] * a + k] - self.steps.mean[own[i] * a + k];
            flat[spread + k] += by_action(i)[k] * f64::from(noise);
        }
        flat.into_iter().map(|g| g as f32).collect()
    }

    fn environments(&self) -> usize {
        self.steps.environments
    }

    /// Gradients of the last rollout by environment; their sum is [`Self::gradient`].
    pub fn gradients(&self, policy: &Policy) -> Vec<Vec<f32>> {
        (0..self.environments()).into_par_iter().map(|env| self.by_parameters(policy, env..env + 1)).collect()
    }
}

impl Engine for Shac {
    fn roll(&mut self, mut on: Stage) -> Result<Taken> {
        let (steps, mut taken) = Steps::rolled(&mut on)?;
        let Stage { episodes, running, policy, config, .. } = on;
        let value = self.value(policy);
        let Found { by_actions, earned, without } = back(&steps, episodes, policy, &value, config)?;
        (self.by_actions, self.earned) = (by_actions, earned);
        let values = |rows: &[f64]| if rows.is_empty() { Vec::new() } else { value.values(&value.answer(rows)) };
        let (acted, last) = steps.rows.split_at(steps.rows.len() - running.stack.rows.len());
        let (own, came) = (values(acted), (&steps.rewards[..], &steps.ends[..]));
        let gains = advantages(came, (&own, &values(last), &values(&steps.cut)), config);
        self.returns = gains.iter().zip(&own).map(|(gain, value)| gain + value).collect();
        self.steps = steps;
        self.gradient = self.by_parameters(policy, 0..self.environments());
        // Nor would another try from there have slopes.
        without.iter().for_each(|env| running.begin(episodes, *env));
        taken.failed += without.len();
        Ok(taken)
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, orders: StreamKey) -> Result<Updated> {
        let norm = self.climb(policy, adam, config, orders);
        policy.returns.absorb(&RunningMoments::of(&self.returns, 1));
        let critic = self.learn(policy, config, orders);
        self.slow.iter_mut().zip(&self.critic.flat).for_each(|(slow, w)| *slow = KEPT * *slow + (1.0 - KEPT) * w);
        let rows = self.returns.len() * policy.shape.inputs();
        policy.seen.absorb(&RunningMoments::of(&self.steps.rows[..rows], policy.shape.inputs()));
        Ok(self.told(policy, norm, critic))
    }

    fn learned(&mut self) -> Result<Vec<(&'static str, &mut Vec<f32>)>> {
        let Self { critic, slow, adam: Adam { m, v, .. }, .. } = self;
        Ok(vec![("critic", &mut critic.flat), ("critic.slow", slow), ("critic.m", m), ("critic.v", v)])
    }
}
