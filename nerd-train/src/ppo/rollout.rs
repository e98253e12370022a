//! One horizon of steps under a policy, and what the update learns from it.

use std::time::Instant;

use nerd_sim::solver::StepError;

use super::engine::Engine;
use super::environments::Environments;
use super::policy::Policy;
use super::stack::Stack;
use super::trainer::PpoError;

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
    /// Episodes that the solver could not go on with.
    pub failed: usize,
    /// Seconds in which the policy answered, and what it saw and did was kept.
    pub policy_seconds: f64,
    /// Seconds in which the solver moved, with the torques of actions, where nobody else counts them.
    pub solver_seconds: Option<f64>,
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
    /// Episodes that have just begun.
    pub fn new(environments: &dyn Environments, stack: usize) -> Self {
        let n = environments.count();
        let stack = Stack::new(stack, environments.observation_dim(), environments.observations());
        Self { stack, rewards: vec![0.0; n], lengths: vec![0.0; n] }
    }

    /// One step. `out` gets the stacked observations that were reached where time ran out.
    pub fn step(&mut self, environments: &mut dyn Environments, actions: &[f64], out: &mut Vec<f64>) -> Result<Stepped, StepError> {
        let result = environments.step(actions)?;
        let mut ended = Vec::new();
        for env in 0..self.rewards.len() {
            self.rewards[env] += result.rewards[env];
            self.lengths[env] += 1.0;
            if result.terminated[env] || result.truncated[env] {
                ended.push((env, self.rewards[env], self.lengths[env]));
                (self.rewards[env], self.lengths[env]) = (0.0, 0.0);
            }
        }
        let over = |env: usize| result.terminated[env] || result.truncated[env];
        let cut: Vec<usize> = (0..self.rewards.len()).filter(|env| result.truncated[*env]).collect();
        self.stack.push(&result.reached, &cut, over, environments.observations(), out);
        Ok(Stepped { result, ended })
    }
}

/// What a step gave.
pub struct Stepped {
    /// The environments' word.
    pub result: nerd_tasks::StepResult,
    /// Environment, return and length of every episode that ended.
    pub ended: Vec<(usize, f64, f64)>,
}

/// Steps every environment `horizon` times under a policy on an engine, which keeps the steps. Step 0 has the noise of number `first`.
///
/// # Errors
/// If the solver cannot step, or the engine's device fails.
pub fn rollout<E: Engine + ?Sized>(
    environments: &mut dyn Environments,
    running: &mut Running,
    engine: &mut E,
    policy: &Policy,
    (horizon, gamma, lambda): (usize, f64, f64),
    (seed, first): (u64, u64),
) -> Result<Taken, PpoError> {
    let (mut taken, mut actions, mut reached) = (Taken::default(), Vec::new(), Vec::new());
    let mut thought = 0.0;
    let mut timed = |work: &mut dyn FnMut(&mut E) -> Result<(), PpoError>| {
        let started = Instant::now();
        let done = work(engine);
        thought += started.elapsed().as_secs_f64();
        done
    };
    timed(&mut |engine| engine.begin(policy))?;
    for t in 0..horizon {
        timed(&mut |engine| engine.act(&running.stack.rows, (seed, first + t as u64), &mut actions))?;
        let stepped = running.step(environments, &actions, &mut reached)?;
        taken.ended.extend(stepped.ended.iter().map(|(env, total, length)| Ended { step: t, env: *env, total: *total, length: *length }));
        taken.failed += stepped.result.failed;
        timed(&mut |engine| engine.arrive(&stepped.result, &reached))?;
    }
    timed(&mut |engine| engine.finish(&running.stack.rows, (gamma, lambda)))?;
    taken.policy_seconds = thought;
    Ok(taken)
}
