//! What a policy answers on, keeps the steps of a rollout in and learns from them: `OnCpu`, or a GPU in `CudaEngine`.

use nerd_sim::solver::StepError;
use nerd_tasks::{Episodes, Snapshot, StepResult};

use super::config::PpoConfig;
use super::error::PpoError;
use super::noise::StreamKey;
use super::policy::Policy;
use super::rollout::{Ended, Running, Taken};
use super::update::{Adam, Updated};

/// One rollout after the other: [`Engine::begin`], then [`Engine::act`] and [`Engine::arrive`] by turns, [`Engine::finish`], and
/// [`Engine::update`].
pub trait Engine: Send {
    /// What the update after the next rollout needs beside it may be made from here on; `orders` is that of [`Engine::update`].
    fn ahead(&mut self, _config: &PpoConfig, _orders: StreamKey) {}

    /// A whole rollout: the steps below by turns, or all of it where the environments are. Its first step has this noise, each later one
    /// the next stream.
    ///
    /// # Errors
    /// If the solver cannot step, the device fails, or another rank is lost.
    fn roll(
        &mut self,
        episodes: &mut Episodes,
        running: &mut Running,
        policy: &Policy,
        config: &PpoConfig,
        noise: StreamKey,
    ) -> Result<Taken, PpoError> {
        rollout(self, episodes, running, policy, config, noise)
    }

    /// A rollout of this policy begins; the one before it is forgotten.
    ///
    /// # Errors
    /// If the device fails, as of all that follow.
    fn begin(&mut self, policy: &Policy) -> Result<(), PpoError>;

    /// Actions `[env][action]` where these rows are seen, kept within +-1, as environments clamp them. The noise of a step is a stream of
    /// its own.
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn act(&mut self, rows: &[f64], noise: StreamKey, actions: &mut Vec<f64>) -> Result<(), PpoError>;

    /// What came of them; `reached` are the rows seen where time ran out, in the order of the environments.
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn arrive(&mut self, result: &StepResult, reached: &[f64]) -> Result<(), PpoError>;

    /// The rollout ends where these rows are seen; its advantages are made.
    ///
    /// # Errors
    /// As [`Engine::begin`].
    fn finish(&mut self, rows: &[f64], config: &PpoConfig) -> Result<(), PpoError>;

    /// All passes over the rollout, by the policy that made it. The order of steps in pass e of iteration i is drawn from a stream of its
    /// own; `orders` are their seed and the iteration.
    ///
    /// # Errors
    /// As [`Engine::begin`]; or if another rank is lost.
    fn update(&mut self, policy: &mut Policy, adam: &mut Adam, config: &PpoConfig, orders: StreamKey) -> Result<Updated, PpoError>;

    /// What later steps depend on.
    ///
    /// # Errors
    /// If the device fails.
    fn snapshot(&self, episodes: &Episodes) -> Result<Snapshot, StepError> {
        Ok(episodes.snapshot())
    }

    /// Goes on where a snapshot was taken.
    ///
    /// # Errors
    /// If it is of other environments.
    fn restore(&mut self, episodes: &mut Episodes, snapshot: &Snapshot) -> Result<(), StepError> {
        episodes.restore(snapshot)
    }
}

/// Steps every environment through a horizon, the engine by turns with them.
pub(super) fn rollout<E: Engine + ?Sized>(
    engine: &mut E,
    episodes: &mut Episodes,
    running: &mut Running,
    policy: &Policy,
    config: &PpoConfig,
    noise: StreamKey,
) -> Result<Taken, PpoError> {
    let (mut taken, mut actions, mut reached) = (Taken::default(), Vec::new(), Vec::new());
    engine.begin(policy)?;
    for t in 0..config.horizon {
        let noise = StreamKey { number: noise.number + t as u64, ..noise };
        engine.act(&running.stack.rows, noise, &mut actions)?;
        let stepped = running.step(episodes, &actions, &mut reached)?;
        taken.ended.extend(stepped.ended.into_iter().map(|ended| Ended { step: t, ..ended }));
        taken.failed += stepped.result.failed;
        engine.arrive(&stepped.result, &reached)?;
    }
    engine.finish(&running.stack.rows, config)?;
    Ok(taken)
}
