//! Hyper-parameters: what rl_games calls `a2c_continuous`, with the paper's values for every task.

use nerd_model::program::Activation;
use nerd_tasks::TaskError;
use serde::{Deserialize, Serialize};

use crate::error::part;
use crate::ranges::{OutOfRange, positive, within};

/// Settings of a run; what a file leaves out is what all tasks of the paper share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
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
    #[serde(default = "tanh")]
    pub activation: Activation,
    /// Observations that the network sees, the newest first; more than one stands in for memory.
    #[serde(default = "one")]
    pub stack: usize,
    /// Whether the spread of actions is an output of the network; else it is a parameter.
    #[serde(default)]
    pub spread_by_state: bool,
    /// Discount a step.
    #[serde(default = "gamma")]
    pub gamma: f64,
    /// Lambda of the advantage estimation.
    #[serde(default = "lambda")]
    pub lambda: f64,
    /// How far the ratio of probabilities may move from that of the rollout.
    #[serde(default = "clip")]
    pub clip: f32,
    /// How far the (normalised) value may; 0 leaves it free. The reference's is 0.2, which learns the Ant's running no faster
    /// (after 60 iterations, one seed: 1321 against 1422; held to values in moments that have moved on, 723).
    #[serde(default)]
    pub value_clip: f32,
    /// Weight of the value's loss.
    #[serde(default = "critic")]
    pub critic: f32,
    /// Weight of the entropy.
    #[serde(default)]
    pub entropy: f32,
    /// Weight of the loss on mean actions beyond +-1.1.
    #[serde(default = "bounds")]
    pub bounds: f32,
    /// Largest global norm of the gradient.
    #[serde(default = "gradient_norm")]
    pub gradient_norm: f32,
    /// First learning rate.
    #[serde(default = "rate")]
    pub rate: f64,
    /// Divergence of two passes' policies that the learning rate is held at: above twice this it falls, below half of it it
    /// rises, by 1.5, within 1e-6 and 1e-2. 0 leaves the rate alone.
    #[serde(default = "kl")]
    pub kl: f64,
}

/// Of a small task of one's own: seconds an iteration at most, on any machine.
impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            environments: 256,
            horizon: 32,
            iterations: 100,
            minibatch: 2048,
            epochs: 5,
            hidden: vec![64, 64],
            activation: tanh(),
            stack: one(),
            spread_by_state: false,
            gamma: gamma(),
            lambda: lambda(),
            clip: clip(),
            value_clip: 0.0,
            critic: critic(),
            entropy: 0.0,
            bounds: bounds(),
            gradient_norm: gradient_norm(),
            rate: rate(),
            kl: kl(),
        }
    }
}

fn tanh() -> Activation {
    Activation::Tanh
}
fn one() -> usize {
    1
}
fn gamma() -> f64 {
    0.99
}
fn lambda() -> f64 {
    0.95
}
fn clip() -> f32 {
    0.2
}
fn critic() -> f32 {
    4.0
}
fn bounds() -> f32 {
    1e-4
}
fn gradient_norm() -> f32 {
    1.0
}
fn rate() -> f64 {
    3e-4
}
fn kl() -> f64 {
    0.008
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

const FILES: [(&str, &str); 5] = [
    ("cartpole-", include_str!("../../assets/ppo/cartpole.toml")),
    ("franka-", include_str!("../../assets/ppo/franka.toml")),
    ("ant-", include_str!("../../assets/ppo/ant.toml")),
    ("anymal-", include_str!("../../assets/ppo/anymal.toml")),
    ("lead-", include_str!("../../assets/ppo/lead.toml")),
];

/// Settings for where steps are dear.
const SMALL: [(&str, &str); 5] = [
    ("cartpole-", include_str!("../../assets/ppo/cartpole-small.toml")),
    ("ant-", include_str!("../../assets/ppo/ant-small.toml")),
    ("franka-", include_str!("../../assets/ppo/franka-small.toml")),
    ("anymal-", include_str!("../../assets/ppo/anymal-small.toml")),
    ("lead-", include_str!("../../assets/ppo/lead-small.toml")),
];

impl PpoConfig {
    /// Fewer environments and more updates a step than the paper's: for a learned simulator on the CPU.
    ///
    /// # Errors
    /// If there is no such task.
    pub fn small(task: &str) -> Result<Self, ConfigError> {
        Self::shipped(&SMALL, task)
    }

    /// The paper's for a task.
    ///
    /// # Errors
    /// If there is no such task.
    pub fn of(task: &str) -> Result<Self, ConfigError> {
        Self::shipped(&FILES, task)
    }

    fn shipped(files: &[(&str, &str)], task: &str) -> Result<Self, ConfigError> {
        let found = files.iter().find(|f| task.starts_with(f.0) && nerd_tasks::names().contains(&task));
        Self::from_text(found.ok_or_else(|| TaskError(task.into()))?.1)
    }

    /// From TOML.
    ///
    /// # Errors
    /// If a key is unknown, missing or out of range.
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
