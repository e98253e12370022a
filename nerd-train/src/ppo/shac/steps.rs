//! A rollout with the records that its backward pass needs.

use nerd_tasks::Trace;

use super::*;
use crate::ppo::engine::endings;

/// Records of a rollout, `[step][env]`.
#[derive(Default)]
pub(super) struct Steps {
    /// Stacked observations. `rows` are those before each step and after the last step. `cut` are the final ones of
    /// truncated episodes, in order of step and environment.
    pub rows: Vec<f64>,
    pub cut: Vec<f64>,
    /// `drawn`: sampled actions before the clamp. `mean`: mean actions of the policy.
    pub drawn: Vec<f32>,
    pub mean: Vec<f32>,
    pub rewards: Vec<f64>,
    pub ends: Vec<u8>,
    pub trace: Trace,
    pub environments: usize,
}

impl Steps {
    /// Steps every environment through a horizon.
    pub fn rolled(
        RolloutInput { episodes, running, policy, config, noise, stop }: &mut RolloutInput,
    ) -> Result<(Self, RolloutStats)> {
        let mut kept = Self::default();
        let mut taken = RolloutStats::default();
        let mut cut = Vec::new();
        let actor = Actor::new((*policy).clone());
        kept.environments = episodes.len();
        episodes.trace();
        for t in 0..config.horizon {
            stop.check()?;
            let answer = actor.answer(&running.stack.rows);
            let drawn = drawn(&answer, StreamKey { number: noise.number + t as u64, ..*noise });
            kept.rows.extend_from_slice(&running.stack.rows);
            let actions = drawn.iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect_vec();
            kept.drawn.extend(drawn);
            kept.mean.extend(answer.mean);
            let (result, ended) = running.step(episodes, &actions, &mut cut)?;
            taken.ended.extend(ended.into_iter().map(|ended| Ended { step: t, ..ended }));
            taken.failed += result.failed.iter().filter(|failed| **failed).count();
            kept.ends.extend(endings(&result));
            kept.rewards.extend(result.rewards);
            kept.cut.extend_from_slice(&cut);
        }
        kept.rows.extend_from_slice(&running.stack.rows);
        kept.trace = episodes.trace();
        Ok((kept, taken))
    }
}
