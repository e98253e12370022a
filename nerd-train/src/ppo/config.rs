//! Hyperparameters, named as in CleanRL and rsl_rl, with the paper's values for every task.

use nerd_model::program::Activation;
use nerd_sim::files::renamed::{self, Kind};

use crate::prelude::*;

/// Training algorithm of a policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Proximal policy optimisation, from samples.
    #[default]
    Ppo,
    /// Short-horizon actor-critic, from gradients of the simulator ([`super::Shac`]).
    Shac,
}

impl Algorithm {
    /// Names of the algorithms in files, as serde writes them.
    pub const WORDS: &[&str] = &["ppo", "shac"];

    fn usual(&self) -> bool {
        *self == Self::Ppo
    }
}

/// Whether `init_noise_std` is the default 1. The default is not serialised: settings of older runs keep their text.
fn whole(std: &f32) -> bool {
    *std == 1.0
}

/// Keys in files of older runs; their values are constants now.
pub(super) const FORMER: [&str; 6] = ["lambda", "critic", "gradient_norm", "gae_lambda", "vf_coef", "max_grad_norm"];

/// Keys that only PPO uses.
const OF_PPO: [&str; 8] = [
    "stack",
    "state_dependent_std",
    "init_noise_std",
    "clip_coef",
    "value_clip",
    "ent_coef",
    "bounds_coef",
    "target_kl",
];

/// Settings of a run; keys missing in a file take the values of [`PpoConfig::default`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PpoConfig {
    /// Algorithm. SHAC has no use for `stack`, `state_dependent_std`, `init_noise_std`, `clip_coef`, `value_clip`,
    /// `ent_coef`, `bounds_coef` and `target_kl`. Default: ppo.
    #[serde(skip_serializing_if = "Algorithm::usual")]
    pub algorithm: Algorithm,
    /// Number of environments. Default: 256.
    pub environments: usize,
    /// Horizon: steps of every environment in one iteration. Default: 32.
    pub horizon: usize,
    /// Iterations of the run. Default: 100.
    pub iterations: u64,
    /// Steps in a minibatch, at most all steps of an iteration. Default: 2048, or all.
    pub minibatch: usize,
    /// Passes over an iteration's steps. Default: 5.
    pub epochs: usize,
    /// Widths of the hidden layers, shared by policy and value. Default: 64, 64.
    pub hidden: Vec<usize>,
    /// Activation between layers. Default: tanh.
    pub activation: Activation,
    /// Stacked observations in the network's input, the newest first; more than 1 serve as memory. Default: 1.
    pub stack: usize,
    /// Whether the log standard deviation of actions is an output of the network; else it is a parameter. Default:
    /// false.
    pub state_dependent_std: bool,
    /// Initial standard deviation of actions. Default: 1.
    #[serde(skip_serializing_if = "whole")]
    pub init_noise_std: f32,
    /// Discount gamma per step. Default: 0.99.
    pub gamma: f64,
    /// Clip range of the probability ratio around 1. Default: 0.2.
    pub clip_coef: f32,
    /// Clip range of the normalised value around the rollout's value; 0 disables it. rl_games uses 0.2. With that, the
    /// Ant's running trains no faster: it reaches 1321 after 60 iterations, against 1422 without the clip (one seed).
    /// Clipped around values that updated moments normalise, it reaches 723. Default: 0.
    pub value_clip: f32,
    /// Weight of the entropy bonus. Default: 0.
    pub ent_coef: f32,
    /// Weight of the loss on mean actions beyond +-1.1. Default: 1e-4.
    pub bounds_coef: f32,
    /// Initial learning rate. Default: 3e-4.
    pub learning_rate: f64,
    /// Target KL divergence between the policies of two successive passes. Above twice the target the learning rate
    /// falls by a factor of 1.5, below half the target it rises. It stays within 1e-6 and 1e-2. 0 keeps the learning
    /// rate constant. Default: 0.008.
    pub target_kl: f64,
}

/// Values shared by all tasks of the paper, and sizes for a small task. An iteration takes seconds at most on any
/// machine.
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
            state_dependent_std: false,
            init_noise_std: 1.0,
            gamma: 0.99,
            clip_coef: 0.2,
            value_clip: 0.0,
            ent_coef: 0.0,
            bounds_coef: 1e-4,
            learning_rate: 3e-4,
            target_kl: 0.008,
        }
    }
}

/// Shipped settings by prefix of the task's name: the paper's, then small ones for solvers with slow steps.
const FILES: [(&str, [&str; 2]); 6] = [
    (
        "cartpole-",
        [include_str!("../../assets/ppo/cartpole.toml"), include_str!("../../assets/ppo/cartpole-small.toml")],
    ),
    ("franka-", [include_str!("../../assets/ppo/franka.toml"), include_str!("../../assets/ppo/franka-small.toml")]),
    ("ant-", [include_str!("../../assets/ppo/ant.toml"), include_str!("../../assets/ppo/ant-small.toml")]),
    ("anymal-", [include_str!("../../assets/ppo/anymal.toml"), include_str!("../../assets/ppo/anymal-small.toml")]),
    ("lead-", [include_str!("../../assets/ppo/lead.toml"), include_str!("../../assets/ppo/lead-small.toml")]),
    // The empty prefix matches all other tasks, which come from files.
    ("", [include_str!("../../assets/ppo/file.toml"), include_str!("../../assets/ppo/file-small.toml")]),
];

/// Shipped settings of SHAC by prefix of the task's name; the last one serves all other tasks.
const SHAC: [(&str, &str); 3] = [
    ("ant-", include_str!("../../assets/ppo/ant-shac.toml")),
    ("anymal-", include_str!("../../assets/ppo/anymal-shac.toml")),
    ("cartpole-", include_str!("../../assets/ppo/cartpole-shac.toml")),
];

/// Whether a task and its robot come with the project; an unknown task is an error.
fn built_in(task: &str) -> Result<bool> {
    let own = nerd_tasks::names().contains(&task);
    if !own {
        nerd_tasks::named(task)?;
    }
    Ok(own)
}

impl PpoConfig {
    /// Small settings for a task, for a learned simulator on the CPU. They have fewer environments and more updates per
    /// step than the paper's settings.
    pub fn small(task: &str) -> Result<Self> {
        Self::shipped(task, 1)
    }

    /// SHAC settings for a task.
    pub fn shac(task: &str) -> Result<Self> {
        let own = built_in(task)?;
        let found = SHAC.iter().find(|f| own && task.starts_with(f.0)).unwrap_or(&SHAC[SHAC.len() - 1]);
        Self::from_text(found.1)
    }

    /// The paper's settings for a task.
    pub fn of(task: &str) -> Result<Self> {
        Self::shipped(task, 0)
    }

    fn shipped(task: &str, which: usize) -> Result<Self> {
        let own = built_in(task)?;
        let found = FILES.iter().find(|f| own && task.starts_with(f.0)).unwrap_or(&FILES[FILES.len() - 1]);
        Self::from_text(found.1[which])
    }

    /// Parses settings from TOML.
    pub fn from_text(text: &str) -> Result<Self> {
        let wrong = |reason: String| Error::Refused(format!("PPO settings: {reason}"));
        let said = |e: toml::de::Error| wrong(e.to_string().trim().replace('\n', " "));
        let (text, old) = renamed::toml(Kind::Ppo, text).map_err(wrong)?;
        renamed::note("PPO settings", old);
        let mut config: Self = toml::from_str(&text).map_err(said)?;
        let given: toml::Table = toml::from_str(&text).map_err(said)?;
        if !given.contains_key("minibatch") {
            config.minibatch = config.minibatch.min(config.steps().max(1));
        }
        config.used(|key| given.contains_key(key)).and_then(|()| config.check()).map_err(wrong)?;
        Ok(config)
    }

    /// Refuses a key that was given although SHAC does not use it.
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

    /// Refuses values outside their ranges, and sizes that no memory holds.
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
            ("learning_rate", (self.learning_rate, 1e-12..=1.0)),
            ("target_kl", (self.target_kl, 0.0..=1e3)),
            ("init_noise_std", (self.init_noise_std.into(), 1e-3..=1e3)),
            ("clip_coef", (self.clip_coef.into(), 0.0..=1e6)),
            ("value_clip", (self.value_clip.into(), 0.0..=1e6)),
            ("ent_coef", (self.ent_coef.into(), 0.0..=1e6)),
            ("bounds_coef", (self.bounds_coef.into(), 0.0..=1e6)),
        ];
        let widths = self.hidden.iter().map(|width| ("hidden", whole(*width, 4096)));
        ranges.into_iter().chain(widths).try_for_each(|(key, (x, range))| within(key, x, range, ""))
    }
}
