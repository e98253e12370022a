//! Short-horizon actor-critic (Xu et al. 2022, arXiv 2204.07137): the policy ascends the gradient of its return.
//! Backpropagation through rollouts finds this gradient.
//!
//! ```text
//! J = 1 / (N h) sum_env [ sum_t c_t R_t + c_h V'(s_h) ]
//! c = 1, gamma, gamma^2, .. from the start of the window or of an episode
//! ```
//!
//! Actions are `clamp(mu + exp(s) noise)` with the noise held constant, so J is a function of the policy. `back.rs`
//! computes the gradient of J through observation, policy, action, solver and reward of every step. No gradient crosses
//! the end of an episode. A terminal state has value 0; a truncated one bootstraps from V', like the state at the
//! horizon. `critic.rs` trains a critic on TD(lambda) returns under V'. Each iteration the target critic V' moves 80 %
//! of the way to that critic. The learning rate falls linearly to a hundredth of the initial one.
//!
//! The clamp has no gradient beyond the bounds, so a policy with little noise could never bring an action back.
//! Therefore a gradient that points back inside the bounds passes the clamp (Hausknecht and Stone 2016).

mod back;
mod behind;
mod critic;
mod frames;
mod steps;
mod through;

use std::ops::Range;

use super::*;
use back::{Found, back};
use steps::Steps;
use through::{By, through};

/// Betas of Adam, as in Xu et al. 2022.
pub(super) const BETA: [f64; 2] = [0.7, 0.95];
/// Share of its previous weights that the target critic V' keeps in an iteration.
pub(super) const KEPT: f32 = 0.2;
/// Initial log standard deviation of actions. A wider distribution has more clamped samples, which have no gradient.
const SPREAD: f32 = -1.0;
/// Smallest learning rate, as a share of the initial one.
const LEAST: f64 = 1e-2;

/// SHAC on the CPU, in any solver with gradients.
pub struct Shac {
    /// Gradient of `-J` of the last rollout with respect to the policy's parameters.
    pub gradient: Vec<f32>,
    /// The objective J of the last rollout.
    pub earned: f64,
    pub(super) critic: Policy,
    pub(super) adam: Adam,
    /// Weights of the target critic V'.
    pub(super) target_critic: Vec<f32>,
    steps: Steps,
    by_actions: Vec<f64>,
    returns: Vec<f64>,
}

impl Shac {
    /// Starts from an untrained policy and narrows its standard deviation. `seed` draws the critic's weights.
    ///
    /// # Errors
    /// If the task, the solver or the sensor model has no gradients.
    pub fn new(episodes: &mut Episodes, policy: &mut Policy, config: &PpoConfig, seed: u64) -> Result<Self> {
        if !episodes.task.has_gradients() {
            refuse!(
                "task `{}` reads numbers of plain code (nerd_tasks::Plain), so it has no gradients: train it by PPO",
                episodes.task.name()
            );
        }
        if episodes.simulation.batch.system.sensed() {
            refuse!(
                "what a policy sees late or with noise has no gradients: leave noise and lag out of [vary], or train it by PPO"
            );
        }
        // A solver without gradients reports so when called.
        let Simulation { batch, solver } = &mut episodes.simulation;
        let robot = &batch.system.robot;
        let torques = vec![0.0; batch.len() * robot.joint_count()];
        let nothing = vec![0.0; batch.len() * 2 * robot.nv()];
        if let Err(error) = solver.vjp(batch, &torques, 1, &nothing) {
            error.faults()?;
        }
        let spread = policy.flat.len() - policy.shape.spread();
        policy.flat[spread..].fill(SPREAD);
        let mut critic = Policy::new(policy.shape.clone(), &mut stream(seed, 0));
        // A zero output layer gives the initial value no gradient; a random gradient would mislead the policy.
        let inside = critic.shape.hidden.last().copied().unwrap_or(critic.shape.inputs());
        let outputs = critic.shape.outputs();
        critic.flat[spread - (inside + 1) * outputs..].fill(0.0);
        let adam = Adam::new(critic.flat.len(), config.learning_rate);
        let target_critic = critic.flat.clone();
        let (gradient, steps, by_actions, returns) = Default::default();
        Ok(Self { gradient, earned: 0.0, critic, adam, target_critic, steps, by_actions, returns })
    }

    /// Sets the learning rates of an iteration and takes the policy's Adam step. Returns the gradient norm before
    /// clipping.
    pub(super) fn policy_step(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: StreamKey,
    ) -> f32 {
        let gradient = std::mem::take(&mut self.gradient);
        let left = (1.0 - orders.number as f64 / config.iterations as f64).max(LEAST);
        (adam.learning_rate, self.adam.learning_rate) = (config.learning_rate * left, config.learning_rate * left);
        // The critic's number of updates so far, derived from the policy's number, which a checkpoint stores.
        self.adam.step = adam.step * (config.epochs * config.steps().div_ceil(config.minibatch)) as u64;
        adam.step(BETA, &mut policy.flat, &gradient)
    }

    /// Statistics of an update, from its gradient norm and the critic's error.
    pub(super) fn told(&self, policy: &Policy, norm: f32, critic: f64) -> Updated {
        let entropy = policy.spread().iter().map(|s| f64::from(*s) + 0.5 * (std::f64::consts::TAU.ln() + 1.0)).sum();
        let terms = Terms { actor: -self.earned, critic, entropy, ..Terms::default() };
        Updated { terms, gradient_norm: norm.into() }
    }

    /// The target critic V', with the policy's moments of observations and returns.
    fn value(&self, policy: &Policy) -> Policy {
        Policy { flat: self.target_critic.clone(), ..policy.clone() }
    }

    /// Contribution of the environments `envs` to the gradient of `-J` with respect to the policy's parameters.
    fn by_parameters(&self, policy: &Policy, envs: Range<usize>) -> Vec<f32> {
        let width = policy.shape.inputs();
        let a = policy.shape.action;
        let n = self.environments();
        let own = (0..self.by_actions.len() / a).filter(|i| envs.contains(&(i % n))).collect_vec();
        let rows = own.iter().flat_map(|i| &self.steps.rows[i * width..][..width]).copied().collect_vec();
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
    fn roll(&mut self, mut on: RolloutInput) -> Result<RolloutStats> {
        let (steps, mut taken) = Steps::rolled(&mut on)?;
        let RolloutInput { episodes, running, policy, config, .. } = on;
        let value = self.value(policy);
        let Found { by_actions, earned, without } = back(&steps, episodes, policy, &value, config)?;
        (self.by_actions, self.earned) = (by_actions, earned);
        let values = |rows: &[f64]| if rows.is_empty() { Vec::new() } else { value.values(&value.answer(rows)) };
        let (acted, last) = steps.rows.split_at(steps.rows.len() - running.stack.rows.len());
        let own = values(acted);
        let came = (&steps.rewards[..], &steps.ends[..]);
        let gains = advantages(came, (&own, &values(last), &values(&steps.cut)), config);
        self.returns = gains.iter().zip(&own).map(|(gain, value)| gain + value).collect();
        self.steps = steps;
        self.gradient = self.by_parameters(policy, 0..self.environments());
        // Restart episodes without gradients: another rollout from the same state would have no gradients either.
        without.iter().for_each(|env| running.begin(episodes, *env));
        taken.failed += without.len();
        Ok(taken)
    }

    fn update(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: StreamKey,
    ) -> Result<Updated> {
        let norm = self.policy_step(policy, adam, config, orders);
        policy.returns.absorb(&RunningMoments::of(&self.returns, 1));
        let critic = self.learn(policy, config, orders);
        self.target_critic
            .iter_mut()
            .zip(&self.critic.flat)
            .for_each(|(target_critic, w)| *target_critic = KEPT * *target_critic + (1.0 - KEPT) * w);
        let rows = self.returns.len() * policy.shape.inputs();
        policy.seen.absorb(&RunningMoments::of(&self.steps.rows[..rows], policy.shape.inputs()));
        Ok(self.told(policy, norm, critic))
    }

    fn learned(&mut self) -> Result<Vec<(&'static str, &mut Vec<f32>)>> {
        let Self { critic, target_critic, adam: Adam { m, v, .. }, .. } = self;
        Ok(vec![("critic", &mut critic.flat), ("critic.slow", target_critic), ("critic.m", m), ("critic.v", v)])
    }
}
