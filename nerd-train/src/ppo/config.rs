//! Hyper-parameters, as of rl_games' `a2c_continuous`, with the paper's values for every task.

use nerd_model::program::Activation;

use crate::prelude::*;

/// How a policy learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// From samples: proximal policy optimisation.
    #[default]
    Ppo,
    /// From slopes: short-horizon actor-critic ([`super::Shac`]).
    Shac,
}

impl Algorithm {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["ppo", "shac"];

    fn usual(&self) -> bool {
        *self == Self::Ppo
    }
}

/// As policies were before there was a choice: their settings stay as they are written.
fn whole(spread: &f32) -> bool {
    *spread == 1.0
}

/// Settings that PPO alone has a use for.
const OF_PPO: [&str; 9] = ["stack", "spread_by_state", "spread", "clip", "value_clip", "critic", "entropy", "bounds", "kl"];

/// Settings of a run; what a file leaves out is [`PpoConfig::default`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoConfig {
    /// How it learns; SHAC has no use for `stack`, `spread_by_state`, `spread`, `clip`, `value_clip`, `critic`, `entropy`, `bounds` and `kl`. Default: ppo.
    #[serde(skip_serializing_if = "Algorithm::usual")]
    pub algorithm: Algorithm,
    /// Environments. Default: 256.
    pub environments: usize,
    /// Steps of every environment in one iteration. Default: 32.
    pub horizon: usize,
    /// Iterations of the run. Default: 100.
    pub iterations: u64,
    /// Steps in a minibatch, at most those of an iteration. Default: 2048, or all.
    pub minibatch: usize,
    /// Passes over an iteration's steps. Default: 5.
    pub epochs: usize,
    /// Widths of the hidden layers, which policy and value share. Default: 64, 64.
    pub hidden: Vec<usize>,
    /// Between them. Default: tanh.
    pub activation: Activation,
    /// Observations that the network sees, the newest first; more than one serve as memory. Default: 1.
    pub stack: usize,
    /// Whether the spread of actions is an output of the network; else it is a parameter. Default: false.
    pub spread_by_state: bool,
    /// First spread of actions. Default: 1.
    #[serde(skip_serializing_if = "whole")]
    pub spread: f32,
    /// Discount a step. Default: 0.99.
    pub gamma: f64,
    /// Lambda of the advantage estimation. Default: 0.95.
    pub lambda: f64,
    /// How far the ratio of probabilities may move from that of the rollout. Default: 0.2.
    pub clip: f32,
    /// How far the (normalised) value may; 0 leaves it free. The reference's is 0.2, which learns the Ant's running no faster
    /// (after 60 iterations, one seed: 1321 against 1422; held to values in moments that have moved on, 723). Default: 0.
    pub value_clip: f32,
    /// Weight of the value's loss. Default: 4.
    pub critic: f32,
    /// Weight of the entropy. Default: 0.
    pub entropy: f32,
    /// Weight of the loss on mean actions beyond +-1.1. Default: 1e-4.
    pub bounds: f32,
    /// Largest global norm of the gradient. Default: 1.
    pub gradient_norm: f32,
    /// First learning rate. Default: 3e-4.
    pub rate: f64,
    /// Divergence of two passes' policies that the learning rate is held at: above twice this it falls, below half of it it
    /// rises, by 1.5, within 1e-6 and 1e-2. 0 leaves the rate alone. Default: 0.008.
    pub kl: f64,
}

/// What all tasks of the paper share, and sizes for a small task of one's own: seconds an iteration at most, on any machine.
impl Default for PpoConfig {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::Ppo,
            environments: 256,
            horizon: 32,
            iterations: 100,
            minibatch: 2048,
            epochs: 5,
            hidden: vec![64, 64],
            activation: Activation::Tanh,
            stack: 1,
            spread_by_state: false,
            spread: 1.0,
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

/// Shipped settings by the beginning of a task's name: the paper's, and those for where steps are dear.
const FILES: [(&str, [&str; 2]); 6] = [
    ("cartpole-", [include_str!("../../assets/ppo/cartpole.toml"), include_str!("../../assets/ppo/cartpole-small.toml")]),
    ("franka-", [include_str!("../../assets/ppo/franka.toml"), include_str!("../../assets/ppo/franka-small.toml")]),
    ("ant-", [include_str!("../../assets/ppo/ant.toml"), include_str!("../../assets/ppo/ant-small.toml")]),
    ("anymal-", [include_str!("../../assets/ppo/anymal.toml"), include_str!("../../assets/ppo/anymal-small.toml")]),
    ("lead-", [include_str!("../../assets/ppo/lead.toml"), include_str!("../../assets/ppo/lead-small.toml")]),
    // Of tasks from files.
    ("", [include_str!("../../assets/ppo/file.toml"), include_str!("../../assets/ppo/file-small.toml")]),
];

/// Shipped settings of SHAC; the last are those of all other tasks.
const SHAC: [(&str, &str); 3] = [
    ("ant-", include_str!("../../assets/ppo/ant-shac.toml")),
    ("anymal-", include_str!("../../assets/ppo/anymal-shac.toml")),
    ("cartpole-", include_str!("../../assets/ppo/cartpole-shac.toml")),
];

/// Whether a task comes with the project, robot and all; refused is one that there is not.
fn built_in(task: &str) -> Result<bool> {
    let own = nerd_tasks::names().contains(&task);
    if !own {
        nerd_tasks::named(task)?;
    }
    Ok(own)
}

impl PpoConfig {
    /// Fewer environments and more updates a step than the paper's: for a learned simulator on the CPU.
    pub fn small(task: &str) -> Result<Self> {
        Self::shipped(task, 1)
    }

    /// SHAC's for a task.
    pub fn shac(task: &str) -> Result<Self> {
        let own = built_in(task)?;
        let found = SHAC.iter().find(|f| own && task.starts_with(f.0)).unwrap_or(&SHAC[SHAC.len() - 1]);
        Self::from_text(found.1)
    }

    /// The paper's for a task.
    pub fn of(task: &str) -> Result<Self> {
        Self::shipped(task, 0)
    }

    fn shipped(task: &str, which: usize) -> Result<Self> {
        let own = built_in(task)?;
        let found = FILES.iter().find(|f| own && task.starts_with(f.0)).unwrap_or(&FILES[FILES.len() - 1]);
        Self::from_text(found.1[which])
    }

    /// From TOML.
    pub fn from_text(text: &str) -> Result<Self> {
        let wrong = |reason: String| Error::Refused(format!("PPO settings: {reason}"));
        let said = |e: toml::de::Error| wrong(e.to_string().trim().replace('\n', " "));
        let mut config: Self = toml::from_str(text).map_err(said)?;
        let given: toml::Table = toml::from_str(text).map_err(said)?;
        if !given.contains_key("minibatch") {
            config.minibatch = config.minibatch.min(config.steps().max(1));
        }
        config.used(|key| given.contains_key(key)).and_then(|()| config.check()).map_err(wrong)?;
        Ok(config)
    }

    /// Refuses a setting that was given and means nothing to SHAC.
    fn used(&self, given: impl Fn(&str) -> bool) -> Result<(), String> {
        match OF_PPO.iter().find(|key| self.algorithm == Algorithm::Shac && given(key)) {
            Some(key) => Err(format!("SHAC has no use for `{key}`: leave it out, or train by PPO")),
            None => Ok(()),
        }
    }

    /// Steps of an iteration.
    pub fn steps(&self) -> usize {
        self.environments.saturating_mul(self.horizon)
    }

    /// Refuses what no run can be made of, or none that memory bears.
    pub fn check(&self) -> Result<(), String> {
        let [own, usual] = [self, &Self::default()].map(|config| serde_json::json!(config));
        self.used(|key| own[key] != usual[key])?;
        let whole = |n: usize, most: usize| (n as f64, 1.0..=most as f64);
        let ranges = [
            ("environments", whole(self.environments, 1 << 20)),
            ("horizon", whole(self.horizon, 1 << 16)),
            ("environments x horizon", whole(self.steps(), 1 << 31)),
            ("iterations", (self.iterations as f64, 1.0..=1e9)),
            ("minibatch", whole(self.minibatch, 1 << 31)),
            ("epochs", whole(self.epochs, 1000)),
            ("stack", whole(self.stack, 64)),
            ("layers of hidden", (self.hidden.len() as f64, 0.0..=16.0)),
            ("gamma", (self.gamma, 0.0..=1.0)),
            ("lambda", (self.lambda, 0.0..=1.0)),
            ("rate", (self.rate, 1e-12..=1.0)),
            ("kl", (self.kl, 0.0..=1e3)),
            ("spread", (self.spread.into(), 1e-3..=1e3)),
            ("gradient_norm", (self.gradient_norm.into(), 1e-9..=1e9)),
            ("clip", (self.clip.into(), 0.0..=1e6)),
            ("value_clip", (self.value_clip.into(), 0.0..=1e6)),
            ("critic", (self.critic.into(), 0.0..=1e6)),
            ("entropy", (self.entropy.into(), 0.0..=1e6)),
            ("bounds", (self.bounds.into(), 0.0..=1e6)),
        ];
        let widths = self.hidden.iter().map(|width| ("hidden", whole(*width, 4096)));
        ranges.into_iter().chain(widths).try_for_each(|(key, (x, range))| within(key, x, range, ""))
    }
}
