//! What a policy answers on, keeps the steps of a rollout in and learns from them: the CPU here, a GPU in `CudaEngine`.

use nerd_sim::sampling::stream;
use nerd_tasks::StepResult;
use rand::RngExt;
use rayon::prelude::*;

use super::config::PpoConfig;
use super::environments::Environments;
use super::gae::{Steps, advantages};
use super::loss::surprise;
use super::policy::{Actor, Answer, Policy};
use super::rollout::{Rollout, Running, Taken, rollout};
use super::trainer::PpoError;
use super::update::{Adam, Updated, update};

/// One rollout after the other: [`Engine::begin`], then [`Engine::act`] and [`Engine::arrive`] by turns, [`Engine::finish`], and
/// [`Engine::update`].
pub trait Engine: Send {
    /// What the update behind the next rollout needs beside it may be made from here on; `seeds` are those of [`Engine::update`].
    fn ahead(&mut self, _config: &PpoConfig, _seeds: (u64, u64)) {}

    /// A whole rollout: the steps below by turns, or all of it where the environments are ([`rollout`]). `law` is how many steps, gamma and
    /// lambda; `noise` is its seed and the number that the first step has in the run.
    ///
    /// # Errors
    /// If the solver cannot step, the device fails, or another rank is lost.
    fn roll(
        &mut self,
        environments: &mut dyn Environments,
        running: &mut Running,
        policy: &Policy,
        law: (usize, f64, f64),
        noise: (u64, u64),
    ) -> Result<Taken, PpoError> {
        rollout(environments, running, self, policy, law, noise)
    }

    /// A rollout of this policy begins; the one before it is forgotten.
    ///
    /// # Errors
    /// If the device fails, as of all that follow.
    fn begin(&mut self, policy: &Policy) -> Result<(), PpoError>;

    /// Actions `[env][action]` where these rows are seen, kept within +-1, as environments clamp them. The noise of step t of the run is a
    /// ChaCha8 stream of its own, keyed by (seed, t).
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn act(&mut self, rows: &[f64], noise: (u64, u64), actions: &mut Vec<f64>) -> Result<(), PpoError>;

    /// What came of them; `reached` are the rows seen where time ran out, in the order of the environments.
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn arrive(&mut self, result: &StepResult, reached: &[f64]) -> Result<(), PpoError>;

    /// The rollout ends where these rows are seen; its advantages by (gamma, lambda).
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn finish(&mut self, rows: &[f64], law: (f64, f64)) -> Result<(), PpoError>;

    /// All passes over the rollout, by the policy that made it. The order of steps in pass e of iteration i is drawn from a ChaCha8 stream of
    /// its own; `seeds` are that of orders and the iteration.
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, seeds: (u64, u64)) -> Result<Updated, PpoError>;
}

/// On the CPU, which does not fail.
#[derive(Default)]
pub struct OnCpu {
    /// The rollout so far.
    pub rollout: Rollout,
    actor: Option<Actor>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    /// Values of the states reached where time ran out, in their order.
    cut: Vec<f64>,
}

impl Engine for OnCpu {
    fn begin(&mut self, policy: &Policy) -> Result<(), PpoError> {
        // What the last rollout took of memory serves this one.
        let Self { rollout, actor, rewards, terminated, truncated, cut } = self;
        *actor = Some(Actor::new(policy.clone()));
        let Rollout { observations, actions, mean, spread, surprise, values, advantages } = rollout;
        [observations, values, advantages, rewards, cut].into_iter().for_each(Vec::clear);
        [actions, mean, spread, surprise].into_iter().for_each(Vec::clear);
        [terminated, truncated].into_iter().for_each(Vec::clear);
        Ok(())
    }

    fn act(&mut self, rows: &[f64], noise: (u64, u64), actions: &mut Vec<f64>) -> Result<(), PpoError> {
        let Some(actor) = &self.actor else { return Ok(()) };
        let (answer, r) = (actor.answer(rows), &mut self.rollout);
        let (drawn, width) = (drawn(&answer, noise), actor.policy.shape.action);
        let said = drawn.par_chunks_exact(width).zip(answer.mean.par_chunks_exact(width)).zip(answer.spread.par_chunks_exact(width));
        r.surprise.par_extend(said.map(|((a, mu), s)| surprise(a, mu, s)));
        r.observations.extend_from_slice(rows);
        r.values.extend(actor.policy.values(&answer));
        r.mean.extend(answer.mean);
        r.spread.extend(answer.spread);
        actions.clear();
        actions.extend(drawn.iter().map(|a| f64::from(a.clamp(-1.0, 1.0))));
        r.actions.extend(drawn);
        Ok(())
    }

    fn arrive(&mut self, result: &StepResult, reached: &[f64]) -> Result<(), PpoError> {
        let Some(actor) = &self.actor else { return Ok(()) };
        self.cut.extend(actor.policy.values(&actor.answer(reached)));
        self.rewards.extend_from_slice(&result.rewards);
        self.terminated.extend_from_slice(&result.terminated);
        self.truncated.extend_from_slice(&result.truncated);
        Ok(())
    }

    fn finish(&mut self, rows: &[f64], (gamma, lambda): (f64, f64)) -> Result<(), PpoError> {
        let Some(actor) = &self.actor else { return Ok(()) };
        let last = actor.policy.values(&actor.answer(rows));
        let (n, values) = (last.len(), &self.rollout.values);
        let mut next: Vec<f64> = values.iter().skip(n).chain(&last).copied().collect();
        // Where time ran out, the state reached is not the one that the next answer is about.
        let over = next.iter_mut().zip(&self.truncated).filter_map(|(value, over)| over.then_some(value));
        over.zip(&self.cut).for_each(|(value, cut)| *value = *cut);
        let Self { rewards, terminated, truncated, .. } = self;
        let steps = Steps { rewards, values, next: &next, terminated, truncated };
        self.rollout.advantages = advantages(&steps, n, gamma, lambda);
        Ok(())
    }

    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, seeds: (u64, u64)) -> Result<Updated, PpoError> {
        Ok(update(policy, adam, &self.rollout, config, seeds))
    }
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
