//! Optimiser updates of a network, on the CPU, a GPU or a device of burn.
//!
//! Loss: squared error in normalised target units, or its pseudo-Huber form `2 d^2 (sqrt(1 + (e / d)^2) - 1)`, averaged
//! over windows, tokens and outputs. Reported losses are always the mean squared error. An update clips the gradient to
//! a global norm, then takes a step of Adam (beta 0.9, 0.999, epsilon 1e-8, no weight decay). A moving average of the
//! weights follows, `a += blend (w - a)` (see [`optimiser::blend`]).

#[cfg(feature = "burn")]
mod burn;
mod cpu;
pub mod muon;
pub mod optimiser;
mod sharded;

#[cfg(feature = "burn")]
pub use burn::BurnLearner;
pub use cpu::CpuLearner;
#[cfg(feature = "cuda")]
pub mod cuda;

use crate::prelude::*;

/// Settings of an update, except the learning rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LearnerConfig {
    /// Windows in an update (paper: 512).
    pub batch: usize,
    /// Largest global norm of the gradient (paper: 1.0).
    pub clip: f32,
    /// Decay of the moving average of the weights per update (paper: none).
    pub average: f64,
    /// Seed of the random draws of training windows.
    pub seed: u64,
    /// Error, in standard deviations of a target, at which the pseudo-Huber loss turns from quadratic to linear.
    /// `None`: quadratic loss (paper).
    pub huber: Option<f32>,
    /// Optimiser of the hidden matrices (paper: Adam).
    pub optimizer: Optimizer,
}

impl LearnerConfig {
    /// Refuses settings outside their ranges.
    pub fn check(&self) -> Result<(), String> {
        within("batch", self.batch as f64, 1.0..=1e6, "")?;
        within("clip", self.clip.into(), 1e-9..=1e9, "")?;
        within("average", self.average, 0.0..=0.999_999, "")?;
        self.huber.map_or(Ok(()), |d| within("huber", d.into(), 1e-9..=1e9, ""))
    }
}

/// Optimiser of the hidden matrices; all other parameters use Adam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimizer {
    /// Adam (paper).
    #[default]
    Adam,
    /// Orthogonalised momentum, see [`muon`].
    Muon,
}

/// State of a run; equal states give equal updates.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnerState {
    /// Number of updates done.
    pub step: u64,
    /// Trained weights.
    pub weights: Weights,
    /// Moving average of the weights.
    pub average: Vec<f32>,
    /// Adam's first moment.
    pub m: Vec<f32>,
    /// Adam's second moment.
    pub v: Vec<f32>,
}

impl LearnerState {
    /// The state before the first update.
    pub fn new(weights: Weights) -> Self {
        let zeros = vec![0.0; weights.flat.len()];
        Self { step: 0, average: weights.flat.clone(), m: zeros.clone(), v: zeros, weights }
    }

    /// The averaged weights.
    pub fn averaged(&self) -> Weights {
        Weights { config: self.weights.config, flat: self.average.clone() }
    }
}

/// Means over the updates since the last report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Training loss: mean squared error in normalised target units.
    pub loss: f32,
    /// Global gradient norm before clipping.
    pub gradient_norm: f32,
}

/// Errors of a learner.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// The loss stopped being finite.
    #[error("loss is {loss} at update {step}: lower the learning rate or look at the data")]
    NotFinite {
        /// Number of the update, counted from 0.
        step: u64,
        /// Loss of that update.
        loss: f32,
    },
    /// The device or its libraries failed.
    #[error("device: {0}")]
    Device(String),
    /// Data and network do not fit together.
    #[error("{0}")]
    Mismatch(String),
}

part!(LearnError);

/// Result of a learner's work.
pub type LearnResult<T = ()> = Result<T, LearnError>;

impl From<String> for LearnError {
    fn from(reason: String) -> Self {
        Self::Mismatch(reason)
    }
}

/// Returns a [`LearnError::Mismatch`].
macro_rules! mismatch {
    ($($text:tt)*) => { return Err($crate::learner::LearnError::Mismatch(format!($($text)*))) };
}
pub(crate) use mismatch;

/// Makes optimiser updates of a network on the training data that it holds.
pub trait Learner {
    /// Makes one update with learning rate `lr`. May return before the device is done.
    fn update(&mut self, lr: f32) -> LearnResult;
    /// Replaces training trajectories, from index `first` on, by the normalised trajectories `fresh` of the same shape.
    fn replace(&mut self, _first: usize, _fresh: &Windows) -> LearnResult {
        Err(LearnError::Mismatch("it learns from motions, no windows can take their places".into()))
    }
    /// Loss and gradient norm averaged over the updates since the last call; waits for the device.
    fn progress(&mut self) -> LearnResult<Progress>;
    /// Normalised MSE of the averaged weights over about `windows` validation windows, chosen by [`validation_rows`].
    fn validate(&mut self, windows: usize) -> LearnResult<f32>;
    /// A copy of the state; waits for the device.
    fn state(&mut self) -> LearnResult<LearnerState>;
}

/// Indices of validation windows, the same on every device: `wanted` of `windows`, evenly spaced. Even spacing is fair,
/// since the order of trajectories carries no meaning.
pub fn validation_rows(windows: usize, wanted: usize) -> Vec<u64> {
    let count = wanted.clamp(1, windows.max(1)) as u64;
    (0..count).map(|k| (u128::from(k) * windows as u128 / u128::from(count)) as u64).collect()
}

#[cfg(feature = "cuda")]
impl From<nerd_cuda::DeviceError> for LearnError {
    fn from(nerd_cuda::DeviceError(message): nerd_cuda::DeviceError) -> Self {
        Self::Device(message)
    }
}

#[cfg(feature = "cuda")]
impl From<LearnError> for nerd_model::transformer::ForwardError {
    fn from(error: LearnError) -> Self {
        Self { message: error.to_string() }
    }
}

#[cfg(feature = "cuda")]
impl From<LearnError> for StepError {
    fn from(error: LearnError) -> Self {
        Self::Solver(error.to_string())
    }
}

/// Refuses settings, a state or windows that do not fit the network or each other.
fn check(config: &LearnerConfig, state: &LearnerState, sets: [&Windows; 2]) -> LearnResult {
    let network = state.weights.config;
    config.check()?;
    network.check()?;
    let n = network.parameters();
    if [&state.weights.flat, &state.average, &state.m, &state.v].iter().any(|x| x.len() != n) {
        mismatch!("a state of {n} parameters is needed");
    }
    for (name, set) in ["training", "validation"].into_iter().zip(sets) {
        let (found, expected) =
            ((set.inputs, set.outputs, set.history), (network.inputs, network.outputs, network.sequence()));
        if found != expected {
            mismatch!("{name} windows have (inputs, outputs, history) {found:?}, the network {expected:?}");
        }
        let tokens = set.trajectories() * set.frames;
        if set.is_empty() || set.x.len() != tokens * set.inputs || set.y.len() != tokens * set.outputs {
            let (x, y) = (set.x.len(), set.y.len());
            mismatch!("{name} windows: {x} inputs and {y} targets make no window");
        }
    }
    Ok(())
}
