//! Hyper-parameters, as of rl_games' `a2c_continuous`, with the paper's values for every task.

use nerd_model::program::Activation;
use nerd_tasks::TaskError;
use serde::{Deserialize, Serialize};

use crate::error::part;
use crate::ranges::{OutOfRange, positive, within};

/// Settings of a run; what a file leaves out is [`PpoConfig::default`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoConfig {
    /// Environments.
    pub environments: usize,
    /// Steps of every environment in one iteration.
    pub horizon: usize,
    /// Iterations of the run.
    pub iterations: u64,
    /// Steps in a minibatch.
    pub minibatch: usize,
    /// Passes over an iteration's steps.
    pub epochs: usize,
    /// Widths of the hidden layers, which policy and value share.
    pub hidden: Vec<usize>,
    /// Between them.
    pub activation: Activation,
    /// Observations that the network sees, the newest first; more than one serve as memory.
    pub stack: usize,
    /// Whether the spread of actions is an output of the network; else it is a parameter.
    pub spread_by_state: bool,
    /// Discount a step.
    pub gamma: f64,
    /// Lambda of the advantage estimation.
    pub lambda: f64,
    /// How far the ratio of probabilities may move from that of the rollout.
    pub clip: f32,
    /// How far the (normalised) value may; 0 leaves it free. The reference's is 0.2, which learns the Ant's running no faster
    /// (after 60 iterations, one seed: 1321 against 1422; held to values in moments that have moved on, 723).
    pub value_clip: f32,
    /// Weight of the value's loss.
    pub critic: f32,
    /// Weight of the entropy.
    pub entropy: f32,
    /// Weight of the loss on mean actions beyond +-1.1.
    pub bounds: f32,
    /// Largest global norm of the gradient.
    pub gradient_norm: f32,
    /// First learning rate.
    pub rate: f64,
    /// Divergence of two passes' policies that the learning rate is held at: above twice this it falls, below half of it it
    /// rises, by 1.5, within 1e-6 and 1e-2. 0 leaves the rate alone.
    pub kl: f64,
}

/// What all tasks of the paper share, and sizes for a small task of one's own: seconds an iteration at most, on any machine.
impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            environments: 256,
            horizon: 32,
            iterations: 100,
            minibatch: 2048,
            epochs: 5,
            hidden: vec![64, 64],
            activation: Activation::Tanh,
            stack: 1,
            spread_by_state: false,
            gamma: 0.99,
            lambda: 0.95,
            clip: 0.2,
            value_clip: 0.0,
            critic: 4.0,
            entropy: 0.0,
            bounds: 1e-4,
            gradient_norm: 1.0,
            rate: 3e-4,
            kl: 0.008,
        }
    }
}

/// Settings that cannot be.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// No such task.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// Not what the file should hold.
    #[error("PPO settings: {0}")]
    Format(String),
    /// A setting out of its range.
    #[error("PPO settings: {0}")]
    Range(#[from] OutOfRange),
}

part!(ConfigError);

/// Shipped settings by the beginning of a task's name: the paper's, and those for where steps are dear.
const FILES: [(&str, [&str; 2]); 5] = [
    ("cartpole-", [include_str!("../../assets/ppo/cartpole.toml"), include_str!("../../assets/ppo/cartpole-small.toml")]),
    ("franka-", [include_str!("../../assets/ppo/franka.toml"), include_str!("../../assets/ppo/franka-small.toml")]),
    ("ant-", [include_str!("../../assets/ppo/ant.toml"), include_str!("../../assets/ppo/ant-small.toml")]),
    ("anymal-", [include_str!("../../assets/ppo/anymal.toml"), include_str!("../../assets/ppo/anymal-small.toml")]),
    ("lead-", [include_str!("../../assets/ppo/lead.toml"), include_str!("../../assets/ppo/lead-small.toml")]),
];

impl PpoConfig {
    /// Fewer environments and more updates a step than the paper's: for a learned simulator on the CPU.
    ///
    /// # Errors
    /// If there is no such task.
    pub fn small(task: &str) -> Result<Self, ConfigError> {
        Self::shipped(task, 1)
    }

    /// The paper's for a task.
    ///
    /// # Errors
    /// If there is no such task.
    pub fn of(task: &str) -> Result<Self, ConfigError> {
        Self::shipped(task, 0)
    }

    fn shipped(task: &str, which: usize) -> Result<Self, ConfigError> {
        let found = FILES.iter().find(|f| task.starts_with(f.0) && nerd_tasks::names().contains(&task));
        Self::from_text(found.ok_or_else(|| TaskError(task.into()))?.1[which])
    }

    /// From TOML.
    ///
    /// # Errors
    /// If a key is unknown or out of range.
    pub fn from_text(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text).map_err(|e| ConfigError::Format(e.to_string().trim().replace('\n', " ")))?;
        config.check()?;
        Ok(config)
    }

    /// Steps of an iteration.
    pub fn steps(&self) -> usize {
        self.environments * self.horizon
    }

    /// Refuses what no run can be made of, or none that memory bears.
    ///
    /// # Errors
    /// Names the first setting that is wrong.
    pub fn check(&self) -> Result<(), ConfigError> {
        for (name, value, most) in [
            ("environments", self.environments, 1 << 20),
            ("horizon", self.horizon, 1 << 16),
            ("minibatch", self.minibatch, 1 << 31),
            ("epochs", self.epochs, 1000),
            ("stack", self.stack, 64),
        ] {
            within(name, value, 1..=most)?;
        }
        self.hidden.iter().try_for_each(|width| within("hidden", *width, 1..=4096))?;
        within("layers of `hidden`", self.hidden.len(), 0..=16)?;
        within("environments` x `horizon", self.steps(), 1..=1 << 31)?;
        within("iterations", self.iterations, 1..=1_000_000_000)?;
        within("gamma", self.gamma, 0.0..=1.0)?;
        within("lambda", self.lambda, 0.0..=1.0)?;
        within("rate", self.rate, positive(1.0))?;
        within("kl", self.kl, 0.0..=1e3)?;
        within("gradient_norm", self.gradient_norm, positive(1e9))?;
        for (name, value) in [
            ("clip", self.clip),
            ("value_clip", self.value_clip),
            ("critic", self.critic),
            ("entropy", self.entropy),
            ("bounds", self.bounds),
        ] {
            within(name, value, 0.0..=1e6)?;
        }
        Ok(())
    }
}
