//! Iterations of rollout and update, and the state of a run.

use std::collections::{BTreeMap, VecDeque};

use super::*;

/// One iteration; a line of `metrics.jsonl`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Iterations done.
    pub step: u64,
    /// Steps so far, summed over all environments.
    pub frames: u64,
    /// Mean return of the last max(environments, 100) ended episodes, or of fewer at first; `None` before any has
    /// ended.
    pub reward: Option<f64>,
    /// Mean length of the episodes that `reward` counts (steps).
    pub length: Option<f64>,
    /// Mean of each reward term per step; empty for rollouts on a GPU.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub terms: BTreeMap<String, f64>,
    /// Episodes that ended in this iteration.
    pub episodes: usize,
    /// Episodes ended by a solver failure, or broken off for a frame without finite gradients.
    pub failed: usize,
    /// Learning rate after the iteration.
    pub learning_rate: f64,
    /// Statistics of the update.
    #[serde(flatten)]
    pub updated: Updated,
    /// Time of the rollout (s).
    pub rollout_seconds: f64,
    /// Time of the update (s).
    pub update_seconds: f64,
}

/// State that later iterations depend on, beside the episodes and the engine.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Iterations done.
    pub iteration: u64,
    /// The policy.
    pub policy: Policy,
    /// Optimiser of the policy.
    pub adam: Adam,
    /// Stacked observations, rewards and lengths of the running episodes.
    pub running: Running,
    /// Return and length of the last ended episodes, from several iterations if needed.
    pub recent: VecDeque<(f64, f64)>,
    /// Largest mean return so far, and the policy that acted when it was reached. In a task with levels, the latest
    /// mean return and its policy instead.
    pub best: Option<(f64, Policy)>,
}

/// A training run of a policy.
pub struct Trainer {
    /// Episodes to learn from.
    pub episodes: Episodes,
    /// Training settings.
    pub config: PpoConfig,
    /// Seed of weights, noise and permutations.
    pub seed: u64,
    /// State of the run after the last iteration.
    pub state: State,
    /// Engine of rollouts and updates.
    pub engine: Box<dyn Engine>,
    /// Limit that breaks off a running iteration with [`Error::Stopped`] (default: none). After that the episodes are
    /// in the middle of an iteration, and the run can only continue from a checkpoint.
    pub stop: Stop,
}

impl Trainer {
    /// A training run from random weights.
    pub fn new(mut episodes: Episodes, config: PpoConfig, seed: u64) -> Result<Self> {
        config.check().and_then(|()| episodes.task.about().check())?;
        let found = episodes.len();
        let wanted = config.environments;
        if found != wanted {
            refuse!("{found} environments, the settings ask for {wanted}");
        }
        let steps = config.steps();
        let PpoConfig { minibatch, horizon, .. } = &config;
        if *minibatch > steps {
            refuse!(
                "minibatch is {minibatch}, an iteration has {steps} steps ({wanted} environments x {horizon}): ask for fewer"
            );
        }
        if config.algorithm == Algorithm::Shac && episodes.task.levels().is_some() {
            refuse!(
                "task `{}` has levels, which PPO alone goes through: take PPO, or a task without levels",
                episodes.task.name()
            );
        }
        episodes.climb();
        let shape = Shape::of(&*episodes.task, &config);
        let mut policy = Policy::new(shape, &mut StreamKey { seed, number: 0 }.rng()).spread_out(config.init_noise_std);
        let engine: Box<dyn Engine> = match config.algorithm {
            Algorithm::Ppo => Box::new(OnCpu::default()),
            Algorithm::Shac => Box::new(Shac::new(&mut episodes, &mut policy, &config, seed)?),
        };
        let adam = Adam::new(policy.flat.len(), config.learning_rate);
        let running = Running::new(&episodes, config.stack);
        let state = State { iteration: 0, policy, adam, running, recent: VecDeque::new(), best: None };
        Ok(Self { episodes, config, seed, state, engine, stop: Stop::default() })
    }

    /// Runs one iteration: a rollout and its update.
    pub fn iterate(&mut self) -> Result<Iteration> {
        let Self { episodes, config, state, engine, stop, .. } = self;
        let started = Instant::now();
        // Noise, permutations and weights must not share streams: each has its own seed.
        let noise = StreamKey { seed: self.seed.wrapping_add(NOISE), number: state.iteration * config.horizon as u64 };
        let orders = StreamKey { seed: self.seed.wrapping_add(ORDERS), number: state.iteration };
        engine.ahead(config, orders);
        let taken = engine.roll(RolloutInput {
            episodes,
            running: &mut state.running,
            policy: &state.policy,
            config,
            noise,
            stop: *stop,
        })?;
        let rolled = started.elapsed().as_secs_f64();
        state.recent.extend(taken.ended.iter().map(|episode| (episode.total, episode.length)));
        let most = config.environments.max(100);
        state.recent.drain(..state.recent.len().saturating_sub(most));
        let mean = |f: fn(&(f64, f64)) -> f64| {
            (!state.recent.is_empty()).then(|| state.recent.iter().map(f).sum::<f64>() / state.recent.len() as f64)
        };
        let (reward, length) = (mean(|e| e.0), mean(|e| e.1));
        // Episodes last longer than an iteration, so earlier policies contribute to the mean return. Keep the policy
        // that acted last, not the one this update makes. With rising levels, earlier returns came from easier terrain
        // and do not compare.
        let better = |reward: f64| episodes.climbs() || state.best.as_ref().is_none_or(|best| reward > best.0);
        if let Some(reward) = reward.filter(|reward| state.recent.len() == most && better(*reward)) {
            state.best = Some((reward, state.policy.clone()));
        }
        let updated = engine.update(&mut state.policy, &mut state.adam, config, orders)?;
        state.iteration += 1;
        updated.check().map_err(|e| format!("iteration {}: {e}", state.iteration))?;
        if state.policy.flat.iter().any(|w| !w.is_finite()) {
            refuse!("iteration {}: a weight of the policy is not finite", state.iteration);
        }
        Ok(Iteration {
            step: state.iteration,
            frames: state.iteration * config.steps() as u64,
            reward,
            length,
            // A reward term may be non-finite where the reward is finite; such a term is left out.
            terms: (episodes
                .task
                .terms()
                .iter()
                .cloned()
                .zip(taken.terms.iter().map(|sum| sum / config.steps() as f64)))
            .filter(|(_, mean)| mean.is_finite())
            .collect(),
            episodes: taken.ended.len(),
            failed: taken.failed,
            learning_rate: state.adam.learning_rate,
            updated,
            rollout_seconds: rolled,
            update_seconds: started.elapsed().as_secs_f64() - rolled,
        })
    }

    /// The policy with the largest mean return and that return ([`State::best`]); before any mean return exists, the
    /// present policy.
    pub fn best(&self) -> (&Policy, Option<f64>) {
        self.state.best.as_ref().map_or((&self.state.policy, None), |(reward, policy)| (policy, Some(*reward)))
    }
}

/// Offsets added to the run's seed for noise and permutations; the seed itself draws the weights.
const NOISE: u64 = 0x6e6f_6973_6500_0000;
const ORDERS: u64 = 0x6f72_6465_7200_0000;
