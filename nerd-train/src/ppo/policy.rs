//! Network of policy and value, with the moments of observations and returns.
//!
//! One trunk has heads for mean action, value and, optionally, log standard deviation. Actions are sampled from
//! `N(mu, exp(s)^2)`, with s a parameter by default; environments clamp them to [-1, 1].

use nerd_model::program::{Program, policy};
use nerd_model::transformer::Init;

use super::*;

/// Rows per parallel task. Partial gradients are summed in order, so the bits do not depend on the number of threads.
pub(super) const ROWS: usize = 512;

/// Shape of a policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Length of an observation (numbers).
    pub observation: usize,
    /// Number of stacked observations in the network's input.
    pub stack: usize,
    /// Length of an action (numbers).
    pub action: usize,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Activation between layers.
    pub activation: Activation,
    /// Whether the log standard deviation is an output of the network; else it is a parameter.
    pub state_dependent_std: bool,
}

impl Shape {
    /// Shape for a task under these settings.
    pub fn of(task: &dyn Task, config: &PpoConfig) -> Self {
        Self {
            observation: task.observation_dim(),
            stack: config.stack,
            action: task.action_dim(),
            hidden: config.hidden.clone(),
            activation: config.activation,
            state_dependent_std: config.state_dependent_std,
        }
    }

    /// Refuses sizes outside the limits of a policy, before memory is allocated.
    pub fn check(&self) -> Result<(), String> {
        let most =
            [("observation", self.observation, 65_536.0), ("stack", self.stack, 64.0), ("action", self.action, 4096.0)];
        let widths = self.hidden.iter().map(|width| ("hidden", *width, 4096.0));
        most.into_iter().chain(widths).try_for_each(|(key, n, most)| within(key, n as f64, 1.0..=most, ""))?;
        within("layers of hidden", self.hidden.len() as f64, 0.0..=16.0, "")
    }

    /// Number of network inputs.
    pub fn inputs(&self) -> usize {
        self.observation * self.stack
    }

    /// Number of network outputs: mean action, value and, if it depends on the state, log standard deviation.
    pub fn outputs(&self) -> usize {
        self.action + 1 + if self.state_dependent_std { self.action } else { 0 }
    }

    /// Number of log standard deviation parameters, the last ones; 0 if they are outputs.
    pub fn spread(&self) -> usize {
        if self.state_dependent_std { 0 } else { self.action }
    }

    /// Widths of all layers, from input to output.
    pub fn widths(&self) -> Vec<usize> {
        [&[self.inputs()], self.hidden.as_slice(), &[self.outputs()]].concat()
    }

    /// The network as a program; the policy holds its parameters.
    pub fn program(&self) -> Program {
        policy(&self.widths(), self.activation, (!self.state_dependent_std).then_some(self.action))
    }
}

/// A policy with its value function.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    /// Shape of the network.
    pub shape: Shape,
    /// Parameters, in the order of [`Shape::program`].
    pub flat: Vec<f32>,
    /// Running moments of stacked observations, which normalise the network's inputs.
    pub seen: RunningMoments,
    /// Running moments of returns, which convert values to units of reward.
    pub returns: RunningMoments,
}

/// Network outputs for n observations.
#[derive(Clone, Debug, Default)]
pub struct PolicyOutput {
    /// Mean actions `[n][action]`.
    pub mean: Vec<f32>,
    /// Log standard deviations `[n][action]`.
    pub spread: Vec<f32>,
    /// Normalised values `[n]`.
    pub value: Vec<f32>,
}

impl Policy {
    /// A policy with random weights; the standard deviation of its actions is 1.
    pub fn new(shape: Shape, rng: &mut ChaCha8Rng) -> Self {
        let mut flat = Vec::new();
        for tensor in shape.program().tensors {
            let bound = if let Init::FanIn(n) = tensor.init { (n as f32).sqrt().recip() } else { 0.0 };
            match bound > 0.0 {
                true => flat.extend((0..tensor.len()).map(|_| (2.0 * rng.random::<f32>() - 1.0) * bound)),
                false => flat.resize(flat.len() + tensor.len(), 0.0),
            }
        }
        if shape.state_dependent_std {
            // Zero weights and biases of the log standard deviations give standard deviation 1 in every state.
            let outputs = shape.outputs();
            let inside = shape.hidden.last().copied().unwrap_or(shape.inputs());
            let start = flat.len() - (inside + 1) * outputs;
            flat[start..].chunks_exact_mut(outputs).for_each(|row| row[shape.action + 1..].fill(0.0));
        }
        Self { seen: RunningMoments::new(shape.inputs()), returns: RunningMoments::new(1), flat, shape }
    }

    /// Sets the initial standard deviation of actions.
    pub(super) fn spread_out(mut self, spread: f32) -> Self {
        // The last parameters are the log standard deviations, or the biases of the outputs that predict them.
        let at = self.flat.len() - self.shape.action;
        self.flat[at..].fill(spread.ln());
        self
    }

    /// The network loaded with the present weights.
    pub fn network(&self) -> Loaded {
        Loaded::new(self.shape.program(), &self.flat)
    }

    /// Mean action, log standard deviation and value for rows of stacked observations, `[n][inputs]`. Repeated calls
    /// should use an [`Actor`].
    pub fn answer(&self, observations: &[f64]) -> PolicyOutput {
        self.answer_by(&self.network(), observations)
    }

    fn answer_by(&self, network: &Loaded, observations: &[f64]) -> PolicyOutput {
        let a = self.shape.action;
        let outputs = self.shape.outputs();
        let parts =
            observations.par_chunks(ROWS * self.shape.inputs()).map_init(Default::default, |(memory, inputs), rows| {
                self.seen.rows(rows, inputs);
                std::mem::take(network.forward(inputs, memory, Pass::Kept(1)))
            });
        let mut answer = PolicyOutput::default();
        for row in parts.collect::<Vec<_>>().iter().flat_map(|part| part.chunks_exact(outputs)) {
            answer.mean.extend_from_slice(&row[..a]);
            answer.value.push(row[a]);
            answer.spread.extend_from_slice(if self.shape.state_dependent_std { &row[a + 1..] } else { self.spread() });
        }
        answer
    }

    /// SHA-256 of weights and moments, as lower-case hex.
    pub fn sha256(&self) -> String {
        let moments = [&self.seen, &self.returns].into_iter().flat_map(|m| m.mean.iter().chain(&m.variance));
        let bytes =
            self.flat.iter().flat_map(|w| w.to_le_bytes()).chain(moments.flat_map(|x| x.to_le_bytes())).collect_vec();
        hex(Sha256::digest(&bytes))
    }

    /// Values `[n]` of `answer`, converted to units of reward.
    pub fn values(&self, answer: &PolicyOutput) -> Vec<f64> {
        answer.value.iter().map(|v| self.returns.restore(0, f64::from(*v))).collect()
    }

    /// Parameters of log standard deviation `[action]`; empty if the network outputs them.
    pub fn spread(&self) -> &[f32] {
        &self.flat[self.flat.len() - self.shape.spread()..]
    }
}

/// A policy for repeated calls, with its network loaded once.
pub struct Actor {
    /// The policy whose weights are loaded.
    pub policy: Policy,
    network: Loaded,
}

impl Actor {
    /// Loads the network with the policy's present weights.
    pub fn new(policy: Policy) -> Self {
        Self { network: policy.network(), policy }
    }

    /// Same as [`Policy::answer`], without loading the network again.
    pub fn answer(&self, observations: &[f64]) -> PolicyOutput {
        self.policy.answer_by(&self.network, observations)
    }

    /// Mean actions `[n][action]`, clamped to [-1, 1].
    pub fn mean(&self, observations: &[f64]) -> Vec<f64> {
        self.answer(observations).mean.into_iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect()
    }
}
