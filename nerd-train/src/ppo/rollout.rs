//! One horizon of steps under a policy, and what the update learns from it.

use std::time::Instant;

use nerd_sim::sampling::stream;
use nerd_sim::solver::StepError;
use rand::RngExt;
use rayon::prelude::*;

use super::environments::Environments;
use super::gae::{Steps, advantages};
use super::loss::surprise;
use super::policy::{Answer, Policy};
use super::stack::Stack;

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
    /// Returns and lengths of the episodes that ended, in order.
    pub ended: Vec<(f64, f64)>,
    /// Episodes that the solver could not go on with.
    pub failed: usize,
    /// Seconds that the policy took to answer.
    pub policy_seconds: f64,
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
    pub fn new(environments: &impl Environments, stack: usize) -> Self {
        let n = environments.count();
        let stack = Stack::new(stack, environments.observation_dim(), environments.observations());
        Self { stack, rewards: vec![0.0; n], lengths: vec![0.0; n] }
    }

    /// One step. `out` gets the stacked observations that were reached where time ran out.
    pub fn step(&mut self, environments: &mut impl Environments, actions: &[f64], out: &mut Vec<f64>) -> Result<Stepped, StepError> {
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

/// Steps every environment `horizon` times. The noise of step t of the run is a ChaCha8 stream of its own, keyed by (seed, t).
///
/// # Errors
/// If the solver cannot step.
pub fn rollout(
    environments: &mut impl Environments,
    running: &mut Running,
    policy: &Policy,
    (horizon, gamma, lambda): (usize, f64, f64),
    (seed, first): (u64, u64),
) -> Result<Rollout, StepError> {
    let n = environments.count();
    let (mut r, mut reached, mut next) = (Rollout::default(), Vec::new(), Vec::new());
    let (mut rewards, mut terminated, mut truncated) = (Vec::new(), Vec::new(), Vec::new());
    let mut thought = 0.0;
    let mut ask = |rows: &[f64]| {
        let started = Instant::now();
        let answer = policy.answer(rows);
        thought += started.elapsed().as_secs_f64();
        answer
    };
    let mut answer = ask(&running.stack.rows);
    r.observations.reserve(horizon * running.stack.rows.len());
    for t in 0..horizon {
        let drawn = drawn(&answer, (seed, first + t as u64));
        let width = drawn.len() / n.max(1);
        let rows = drawn.par_chunks_exact(width).zip(answer.mean.par_chunks_exact(width)).zip(answer.spread.par_chunks_exact(width));
        r.surprise.par_extend(rows.map(|((a, mu), s)| surprise(a, mu, s)));
        r.observations.extend_from_slice(&running.stack.rows);
        r.mean.extend_from_slice(&answer.mean);
        r.spread.extend_from_slice(&answer.spread);
        r.values.extend(policy.values(&answer));
        let actions: Vec<f64> = drawn.iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        r.actions.extend(drawn);
        let stepped = running.step(environments, &actions, &mut reached)?;
        r.ended.extend(stepped.ended.iter().map(|(_, total, length)| (*total, *length)));
        r.failed += stepped.result.failed;
        answer = ask(&running.stack.rows);
        let mut values = policy.values(&answer);
        // Where time ran out, the state reached is not the one that the next answer is about.
        let there = policy.values(&ask(&reached));
        (0..n).filter(|env| stepped.result.truncated[*env]).zip(there).for_each(|(env, value)| values[env] = value);
        next.extend(values);
        rewards.extend(stepped.result.rewards);
        terminated.extend(stepped.result.terminated);
        truncated.extend(stepped.result.truncated);
    }
    let steps = Steps { rewards: &rewards, values: &r.values, next: &next, terminated: &terminated, truncated: &truncated };
    r.policy_seconds = thought;
    r.advantages = advantages(&steps, n, gamma, lambda);
    Ok(r)
}

/// Actions around their means. Noise is one stream; a part of it begins where those before it would end.
fn drawn(answer: &Answer, (seed, step): (u64, u64)) -> Vec<f32> {
    /// Numbers of a part: even, since they are drawn in twos, of four words each.
    const PART: usize = 4096;
    let mut out = vec![0.0; answer.mean.len()];
    let said = answer.mean.par_chunks(PART).zip(answer.spread.par_chunks(PART));
    out.par_chunks_mut(PART).zip(said).enumerate().for_each(|(part, (out, (mean, spread)))| {
        let (mut rng, mut spare) = (stream(seed, step), None);
        rng.set_word_pos(2 * (part * PART) as u128);
        for ((a, mu), s) in out.iter_mut().zip(mean).zip(spread) {
            *a = mu + s.exp() * normal(&mut rng, &mut spare);
        }
    });
    out
}

/// A standard normal number (Box and Muller), two at a time.
pub(super) fn normal(rng: &mut rand_chacha::ChaCha8Rng, spare: &mut Option<f32>) -> f32 {
    if let Some(x) = spare.take() {
        return x;
    }
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    let (radius, (sin, cos)) = ((-2.0 * u.ln()).sqrt(), (std::f64::consts::TAU * v).sin_cos());
    *spare = Some((radius * sin) as f32);
    (radius * cos) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_drawn_in_parts_is_that_of_one_stream() {
        let n = 10_001;
        let answer = Answer { mean: vec![0.5; n], spread: (0..n).map(|k| (k as f32 * 0.01).sin()).collect(), value: Vec::new() };
        let (mut rng, mut spare) = (stream(3, 9), None);
        let one: Vec<f32> = answer.mean.iter().zip(&answer.spread).map(|(mu, s)| mu + s.exp() * normal(&mut rng, &mut spare)).collect();
        let parts = drawn(&answer, (3, 9));
        let first = one.iter().zip(&parts).position(|(a, b)| a != b);
        assert_eq!(first, None, "the first number that differs");
    }
}
