//! The trait of engines, which roll out and update a policy: PPO's `OnCpu`, `CudaEngine` on a GPU, and `Shac`.

use nerd_tasks::StepResult;

use super::*;

/// Inputs of a rollout.
pub struct RolloutInput<'a> {
    /// Episodes to step.
    pub episodes: &'a mut Episodes,
    /// State of the running episodes.
    pub running: &'a mut Running,
    /// Policy that samples the actions.
    pub policy: &'a Policy,
    /// Settings, among them horizon and discount.
    pub config: &'a PpoConfig,
    /// Noise stream of the first step; each later step takes the next stream.
    pub noise: StreamKey,
    /// Limit that breaks the rollout off.
    pub stop: Stop,
}

/// Performs both halves of an iteration: the rollout and the update of the policy.
pub trait Engine: Send {
    /// May start to draw the step permutations for the update after the next rollout. [`Engine::update`] later gets the
    /// same key `orders`.
    fn ahead(&mut self, _config: &PpoConfig, _orders: StreamKey) {}

    /// Steps every environment through one horizon ([`PpoConfig::horizon`] steps).
    fn roll(&mut self, on: RolloutInput) -> Result<RolloutStats>;

    /// Runs all passes over the last rollout, made by `policy`. Each pass of each iteration draws its permutation of
    /// steps from a separate stream. `orders` holds the seed of these streams and the number of the iteration.
    fn update(
        &mut self,
        policy: &mut Policy,
        adam: &mut Adam,
        config: &PpoConfig,
        orders: StreamKey,
    ) -> Result<Updated>;

    /// Snapshot of the episodes, with everything that later steps depend on.
    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        Ok(episodes.snapshot())
    }

    /// Sets the episodes to a snapshot, to continue from there.
    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        episodes.restore(snapshot)
    }

    /// Learned vectors beside the policy, by name; checkpoints store them.
    fn learned(&mut self) -> Result<Vec<(&'static str, &mut Vec<f32>)>> {
        Ok(Vec::new())
    }

    /// Time of the last iteration by stage (s); empty if stages are not timed.
    fn spent(&self) -> &[(&'static str, f64)] {
        &[]
    }
}

/// How a step ended the episode of each environment: 0 (not at all), [`TERMINATED`] or [`TRUNCATED`].
pub(super) fn endings(result: &StepResult) -> impl Iterator<Item = u8> {
    let both = result.terminated.iter().zip(&result.truncated);
    both.map(|(terminated, truncated)| if *terminated { TERMINATED } else { TRUNCATED * u8::from(*truncated) })
}

/// A rollout that alternates policy and episodes: [`StepwiseRollout::begin`], then [`StepwiseRollout::act`] and
/// [`StepwiseRollout::arrive`] per step, then [`StepwiseRollout::finish`].
pub trait StepwiseRollout {
    /// Performs [`Engine::roll`] by turns of policy and episodes.
    fn turns(
        &mut self,
        RolloutInput { episodes, running, policy, config, noise, stop }: RolloutInput,
    ) -> Result<RolloutStats> {
        let mut taken = RolloutStats::default();
        let mut actions = Vec::new();
        let mut reached = Vec::new();
        let mut rewards = Vec::new();
        let mut ends = Vec::new();
        self.begin(policy)?;
        for t in 0..config.horizon {
            stop.check()?;
            let noise = StreamKey { number: noise.number + t as u64, ..noise };
            self.act(&running.stack.rows, noise, &mut actions)?;
            let (result, ended) = running.step(episodes, &actions, &mut reached)?;
            taken.ended.extend(ended.into_iter().map(|ended| Ended { step: t, ..ended }));
            taken.failed += result.failed.iter().filter(|failed| **failed).count();
            ends.extend(endings(&result));
            taken.terms.resize(episodes.task.terms().len(), 0.0);
            for terms in result.terms.chunks_exact(taken.terms.len().max(1)) {
                add(&mut taken.terms, terms);
            }
            rewards.extend(result.rewards);
            self.arrive(&reached, &result.truncated)?;
        }
        self.finish(&running.stack.rows, &rewards, &ends, config)?;
        Ok(taken)
    }

    /// Begins a rollout of this policy and clears the last one.
    fn begin(&mut self, policy: &Policy) -> Result<()>;

    /// Samples actions `[env][action]`, clamped to [-1, 1], for stacked observations `rows`. Each step has a separate
    /// noise stream.
    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<()>;

    /// Records a step. `truncated` marks the environments with a truncated episode. `reached` holds the stacked final
    /// observations of these environments, in order.
    fn arrive(&mut self, reached: &[f64], truncated: &[bool]) -> Result<()>;

    /// Ends the rollout with the stacked observations `rows` after the last step, and computes advantages. `rewards`
    /// and `ends` are `[step][env]`; an end is 0, [`TERMINATED`] or [`TRUNCATED`].
    fn finish(&mut self, rows: &[f64], rewards: &[f64], ends: &[u8], config: &PpoConfig) -> Result<()>;
}
