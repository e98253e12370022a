//! [`OnCpu`]: rollouts and PPO updates on the CPU.

use super::loss::neg_log_prob;
use super::update::update;
use super::*;

/// PPO on the CPU.
#[derive(Default)]
pub struct OnCpu {
    /// The last rollout, complete or under way.
    pub rollout: Rollout,
    actor: Option<Actor>,
    /// Values of the final states of truncated episodes, in order.
    cut: Vec<f64>,
}

impl StepwiseRollout for OnCpu {
    fn begin(&mut self, policy: &Policy) -> Result<()> {
        self.actor = Some(Actor::new(policy.clone()));
        self.rollout.clear();
        self.cut.clear();
        Ok(())
    }

    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<()> {
        let Some(actor) = &self.actor else { return Ok(()) };
        let answer = actor.answer(rows);
        let r = &mut self.rollout;
        let width = actor.policy.shape.action;
        let drawn = drawn(&answer, noise);
        let said = drawn
            .par_chunks_exact(width)
            .zip(answer.mean.par_chunks_exact(width))
            .zip(answer.spread.par_chunks_exact(width));
        r.neg_log_prob.par_extend(said.map(|((a, mu), s)| neg_log_prob(a, mu, s)));
        r.observations.extend_from_slice(rows);
        r.values.extend(actor.policy.values(&answer));
        r.mean.extend(answer.mean);
        r.spread.extend(answer.spread);
        actions.clear();
        actions.extend(drawn.iter().map(|a| f64::from(a.clamp(-1.0, 1.0))));
        r.actions.extend(drawn);
        Ok(())
    }

    fn arrive(&mut self, reached: &[f64], _: &[bool]) -> Result<()> {
        let Some(actor) = &self.actor else { return Ok(()) };
        self.cut.extend(actor.policy.values(&actor.answer(reached)));
        Ok(())
    }

    fn finish(&mut self, rows: &[f64], rewards: &[f64], ends: &[u8], config: &PpoConfig) -> Result<()> {
        let Some(actor) = &self.actor else { return Ok(()) };
        let last = actor.policy.values(&actor.answer(rows));
        self.rollout.advantages = advantages((rewards, ends), (&self.rollout.values, &last, &self.cut), config);
        Ok(())
    }
}

impl Engine for OnCpu {
    fn roll(&mut self, on: RolloutInput) -> Result<RolloutStats> {
        self.turns(on)
    }

    fn update(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: StreamKey,
    ) -> Result<Updated> {
        Ok(update(policy, adam, &self.rollout, config, orders))
    }
}
