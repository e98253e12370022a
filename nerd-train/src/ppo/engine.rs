//! What a policy answers on, keeps the steps of a rollout in and learns from them: PPO's `OnCpu`, or a GPU in `CudaEngine`, and `Shac`.

use nerd_tasks::StepResult;

use super::*;

/// What a rollout is made of.
pub struct Stage<'a> {
    /// What is stepped.
    pub episodes: &'a mut Episodes,
    /// How far they have come.
    pub running: &'a mut Running,
    /// Who acts.
    pub policy: &'a Policy,
    /// Horizon, discount.
    pub config: &'a PpoConfig,
    /// Of the first step; each later one has the next stream.
    pub noise: StreamKey,
    /// When it is broken off.
    pub stop: Stop,
}

/// One rollout after the other, each with its update.
pub trait Engine: Send {
    /// What the update after the next rollout needs beside it may be made from here on; `orders` is the key given to [`Engine::update`].
    fn ahead(&mut self, _config: &PpoConfig, _orders: StreamKey) {}

    /// Steps every environment through a horizon.
    fn roll(&mut self, on: Stage) -> Result<Taken>;

    /// All passes over the rollout, by the policy that made it. The order of steps in pass e of iteration i is drawn from a stream of its
    /// own; `orders` are their seed and the iteration.
    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, orders: StreamKey) -> Result<Updated>;

    /// What later steps depend on.
    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        Ok(episodes.snapshot())
    }

    /// Goes on where a snapshot was taken.
    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        episodes.restore(snapshot)
    }

    /// What it has learned beside the policy, by name.
    fn learned(&mut self) -> Result<Vec<(&'static str, &mut Vec<f32>)>> {
        Ok(Vec::new())
    }

    /// Seconds of the last iteration by part, if it has parts.
    fn spent(&self) -> &[(&'static str, f64)] {
        &[]
    }
}

/// How a step ended in each environment: not (0), in [`TERMINATED`] or in [`TRUNCATED`].
pub(super) fn endings(result: &StepResult) -> impl Iterator<Item = u8> {
    let both = result.terminated.iter().zip(&result.truncated);
    both.map(|(terminated, truncated)| if *terminated { TERMINATED } else { TRUNCATED * u8::from(*truncated) })
}

/// A rollout by turns of a policy and the episodes: [`Turns::begin`], then [`Turns::act`] and [`Turns::arrive`] by turns, and
/// [`Turns::finish`].
pub trait Turns {
    /// [`Engine::roll`].
    fn turns(&mut self, Stage { episodes, running, policy, config, noise, stop }: Stage) -> Result<Taken> {
        let (mut taken, mut actions, mut reached) = (Taken::default(), Vec::new(), Vec::new());
        let (mut rewards, mut ends) = (Vec::new(), Vec::new());
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
                taken.terms.iter_mut().zip(terms).for_each(|(sum, x)| *sum += x);
            }
            rewards.extend(result.rewards);
            self.arrive(&reached, &result.truncated)?;
        }
        self.finish(&running.stack.rows, &rewards, &ends, config)?;
        Ok(taken)
    }

    /// A rollout of this policy begins; the one before it is forgotten.
    fn begin(&mut self, policy: &Policy) -> Result<()>;

    /// Actions `[env][action]` where these rows are seen, kept within +-1, as environments clamp them. The noise of a step is a stream of
    /// its own.
    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<()>;

    /// They were taken; `reached` are the rows seen where time ran out, of these environments, in their order.
    fn arrive(&mut self, reached: &[f64], truncated: &[bool]) -> Result<()>;

    /// The rollout ends where these rows are seen; of what came of its steps, `[step][env]`, advantages are made. A step ends no episode (0),
    /// or in [`TERMINATED`] or [`TRUNCATED`].
    fn finish(&mut self, rows: &[f64], rewards: &[f64], ends: &[u8], config: &PpoConfig) -> Result<()>;
}
