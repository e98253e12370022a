//! Passes over one rollout: minibatches, gradients, Adam, and the learning rate adapted to the KL divergence.
//!
//! The return normaliser absorbs the rollout before the passes, the observation normaliser after them. So the network's
//! inputs stay the same, and the first probability ratio of an update is 1. As in rl_games, each minibatch stores the
//! policy's present means and log standard deviations for its steps. The KL divergence therefore compares policies one
//! pass apart, not those before and after the whole update.

use std::sync::MutexGuard;

use super::loss::{Past, divergence, figure, step};
use super::policy::ROWS;
use super::*;
use crate::learner::optimiser::{self, norm};

/// Largest global norm of a gradient.
pub(super) const GRADIENT_NORM: f32 = 1.0;
/// `RATES`: smallest and largest learning rate. `FACTOR`: factor of one change of the learning rate.
const RATES: [f64; 2] = [1e-6, 1e-2];
const FACTOR: f64 = 1.5;

/// Adam's state (beta 0.9, 0.999, epsilon 1e-8).
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// First moments of the gradient's entries.
    pub m: Vec<f32>,
    /// Second moments of the gradient's entries.
    pub v: Vec<f32>,
    /// Number of updates so far.
    pub step: u64,
    /// Learning rate of the next update.
    pub learning_rate: f64,
}

impl Adam {
    /// State before the first update.
    pub fn new(parameters: usize, learning_rate: f64) -> Self {
        Self { m: vec![0.0; parameters], v: vec![0.0; parameters], step: 0, learning_rate }
    }

    /// One update with these betas and the gradient norm clipped to [`GRADIENT_NORM`]; returns the norm before
    /// clipping.
    pub(super) fn step(&mut self, beta: [f64; 2], flat: &mut [f32], gradient: &[f32]) -> f32 {
        let found = norm(gradient);
        self.step += 1;
        optimiser::Adam::new(beta, self.step, self.learning_rate, found, GRADIENT_NORM)
            .step([flat, &mut self.m, &mut self.v], gradient);
        found
    }
}

/// Statistics of an update: means over all its minibatches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Updated {
    /// Terms of the loss.
    #[serde(flatten)]
    pub terms: Terms,
    /// Norm of the gradient before clipping.
    #[serde(deserialize_with = "figure")]
    pub gradient_norm: f64,
}

impl Updated {
    /// Refuses non-finite statistics: the policy has diverged.
    pub(super) fn check(&self) -> Result<()> {
        let figures = self.terms.named().into_iter().chain([("gradient_norm", self.gradient_norm)]);
        match figures.into_iter().find(|(_, x)| !x.is_finite()) {
            Some((name, x)) => {
                refuse!("{name} is {x}, the policy has diverged: take a smaller `learning_rate`, and another --out")
            }
            None => Ok(()),
        }
    }
}

/// All passes over one rollout; see [`super::Engine::update`].
pub(super) fn update(
    policy: &mut Policy,
    adam: &mut Adam,
    rollout: &Rollout,
    config: &PpoConfig,
    key: StreamKey,
) -> Updated {
    let mut data = Data::begun(policy, rollout);
    let mut sums = Terms::default();
    let mut norms = 0.0;
    let mut batches = 0.0;
    let mut network = TrainingNetwork::new(policy);
    for order in orders(config, key) {
        for batch in order.chunks(config.minibatch) {
            let said = gradient(policy, &network, &data, batch, 1.0 / batch.len() as f32, config);
            data.compare_with(batch, &said);
            norms += f64::from(adam.step([0.9, 0.999], &mut policy.flat, &said.flat));
            network.load(policy);
            let terms = said.terms.over(batch.len() as f64);
            sums.add(&terms);
            batches += 1.0;
            if config.target_kl > 0.0 && terms.kl > 2.0 * config.target_kl {
                adam.learning_rate = (adam.learning_rate / FACTOR).max(RATES[0]);
            } else if config.target_kl > 0.0 && terms.kl < 0.5 * config.target_kl {
                adam.learning_rate = (adam.learning_rate * FACTOR).min(RATES[1]);
            }
        }
    }
    policy.seen.absorb(&RunningMoments::of(&rollout.observations, policy.shape.inputs()));
    Updated { terms: sums.over(batches), gradient_norm: norms / batches }
}

/// A permutation of all steps of an iteration for each pass.
pub(super) fn orders(
    config: &PpoConfig,
    StreamKey { seed, number }: StreamKey,
) -> impl Iterator<Item = Vec<u32>> + use<> {
    let n = config.steps();
    let epochs = config.epochs as u64;
    let mut order = (0..n as u32).collect_vec();
    (0..epochs).map(move |epoch| {
        let mut rng = StreamKey { seed, number: number * epochs + epoch }.rng();
        (1..n).rev().for_each(|i| order.swap(i, rng.random_range(0..=i)));
        order.clone()
    })
}

/// A rollout with normalised inputs, advantages, value targets and values.
struct Data<'a> {
    rollout: &'a Rollout,
    inputs: Vec<f32>,
    advantages: Vec<f32>,
    value_targets: Vec<f32>,
    values: Vec<f32>,
    mean: Vec<f32>,
    spread: Vec<f32>,
}

impl<'a> Data<'a> {
    /// Absorbs the returns into the policy's moments, then normalises advantages, value targets and inputs.
    fn begun(policy: &mut Policy, rollout: &'a Rollout) -> Self {
        let returns = rollout.advantages.iter().zip(&rollout.values).map(|(a, v)| a + v).collect_vec();
        // Normalise old values by the moments that they were predicted with. By the updated moments, value clipping
        // would compare with values that were never predicted.
        let values = rollout.values.iter().map(|v| policy.returns.normalize(0, *v) as f32).collect();
        policy.returns.absorb(&RunningMoments::of(&returns, 1));
        let all = RunningMoments::of(&rollout.advantages, 1);
        let mean = all.mean[0];
        let deviation = all.variance[0].sqrt() + 1e-8;
        let advantages = rollout.advantages.iter().map(|a| ((a - mean) / deviation) as f32).collect();
        let value_targets = returns.iter().map(|x| policy.returns.normalize(0, *x) as f32).collect();
        let inputs = policy.seen.all_rows(&rollout.observations);
        let (mean, spread) = (rollout.mean.clone(), rollout.spread.clone());
        Self { inputs, advantages, value_targets, values, mean, spread, rollout }
    }

    /// Stores the latest outputs for these steps, as the reference of the next pass's KL divergence.
    fn compare_with(&mut self, batch: &[u32], said: &Gradient) {
        let a = self.mean.len() / self.values.len().max(1);
        for (i, mean, spread) in izip!(batch, said.mean.chunks_exact(a), said.spread.chunks_exact(a)) {
            let i = *i as usize;
            self.mean[i * a..][..a].copy_from_slice(mean);
            self.spread[i * a..][..a].copy_from_slice(spread);
        }
    }
}

#[derive(Default)]
struct Gradient {
    /// Gradient of the mean loss with respect to the policy's parameters.
    flat: Vec<f32>,
    terms: Terms,
    /// Present mean actions and log standard deviations of the steps, `[step][action]`.
    mean: Vec<f32>,
    spread: Vec<f32>,
}

/// The policy's network between minibatches, with thread memory for reuse.
struct TrainingNetwork {
    network: Loaded,
    idle: Mutex<Vec<Workspace>>,
}

/// Memory of a thread: activations, inputs, and the gradient with respect to the outputs.
#[derive(Default)]
struct Workspace {
    memory: Memory,
    inputs: Vec<f32>,
    upstream: Vec<f32>,
}

impl TrainingNetwork {
    fn new(policy: &Policy) -> Self {
        let network = Self { network: policy.network(), idle: Mutex::default() };
        network.network.turn();
        network
    }

    fn load(&mut self, policy: &Policy) {
        self.network.load(&policy.flat);
        self.network.turn();
    }

    fn idle(&self) -> MutexGuard<'_, Vec<Workspace>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Forward and backward pass over a minibatch; `scale` (1 / batch size) multiplies each step's loss.
fn gradient(
    policy: &Policy,
    network: &TrainingNetwork,
    data: &Data,
    batch: &[u32],
    scale: f32,
    config: &PpoConfig,
) -> Gradient {
    let shape = &policy.shape;
    let a = shape.action;
    let width = shape.inputs();
    let outputs = shape.outputs();
    let parts = batch.par_chunks(ROWS).map(|rows| {
        let mut workspace = network.idle().pop().unwrap_or_default();
        let Workspace { memory, inputs, upstream } = &mut workspace;
        inputs.clear();
        rows.iter().for_each(|i| inputs.extend_from_slice(&data.inputs[*i as usize * width..][..width]));
        upstream.clear();
        upstream.resize(rows.len() * outputs, 0.0);
        let mut part = Gradient::default();
        let mut of_spread = vec![0.0; a];
        let mut spreads = vec![0.0; shape.spread()];
        let answers = network.network.forward(inputs, memory, Pass::Kept(1)).chunks_exact(outputs);
        for (i, said, d) in izip!(rows, answers, upstream.chunks_exact_mut(outputs)) {
            let i = *i as usize;
            let past = Past {
                action: &data.rollout.actions[i * a..][..a],
                neg_log_prob: data.rollout.neg_log_prob[i],
                advantage: data.advantages[i],
                value_target: data.value_targets[i],
                value: data.values[i],
            };
            let s = if shape.state_dependent_std { &said[a + 1..] } else { policy.spread() };
            let (d_mu, rest) = d.split_at_mut(a);
            let (d_v, d_out) = rest.split_at_mut(1);
            let d_s = if shape.state_dependent_std { d_out } else { &mut of_spread[..] };
            let mut one = step(config, past, (&said[..a], s, said[a]), scale, (d_mu, d_s, &mut d_v[0]));
            one.kl = f64::from(divergence(&said[..a], s, &data.mean[i * a..][..a], &data.spread[i * a..][..a]));
            part.terms.add(&one);
            add(&mut spreads, d_s);
            part.mean.extend_from_slice(&said[..a]);
            part.spread.extend_from_slice(s);
        }
        part.flat = network.network.backward(1, upstream, memory, false).0;
        network.idle().push(workspace);
        // The log standard deviations are the last tensor, whose gradient the network's backward pass does not compute.
        let network = part.flat.len() - spreads.len();
        part.flat[network..].copy_from_slice(&spreads);
        part
    });
    let mut sum = Gradient { flat: vec![0.0; policy.flat.len()], ..Default::default() };
    for part in parts.collect::<Vec<_>>() {
        add(&mut sum.flat, &part.flat);
        sum.terms.add(&part.terms);
        sum.mean.extend(part.mean);
        sum.spread.extend(part.spread);
    }
    sum
}
