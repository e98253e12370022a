//! Options of `train`.

use std::path::PathBuf;

use super::variant::Variant;
use crate::common::{DEVICES, Device, TRUTHS, word};
use crate::numbers::{BATCH, EMBEDDING, FRAMES, LAYERS, SEEDS, TRANSITIONS, UPDATES, count, positive, share, within};
use crate::truth::Truth;

/// Train a NeRD model.
#[derive(clap::Args, Clone, Debug)]
pub struct TrainArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, anymal-paper, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Folder of the run; the same command continues it
    #[arg(long)]
    pub out: PathBuf,
    /// Size of the network and of the run: `paper` (E 192, 6 layers, batch 512) or `small` (E 48, 2 layers, batch 128); or the
    /// name of a model in `models/`, which is trained again, all of its runs (--updates and --transitions then are caps)
    #[arg(long, default_value = "paper")]
    pub preset: Preset,
    /// Tokens of a window, in place of the preset's
    #[arg(long, value_parser = count::<usize>(1..=1024))]
    pub history: Option<usize>,
    /// Rotary positions: rollouts evaluate one token a frame in place of a window
    #[arg(long)]
    pub stream: bool,
    /// Tokens of a training sequence with --stream [default: as many as a prediction of a rollout depends on, 55 with six layers
    /// and windows of 10, and at least 32]
    #[arg(long, requires = "stream", value_parser = count::<usize>(1..=8192))]
    pub sequence: Option<usize>,
    /// Width of the network, in place of the preset's
    #[arg(long, value_parser = count::<usize>(EMBEDDING))]
    pub embedding: Option<usize>,
    /// Layers of the network, in place of the preset's
    #[arg(long, value_parser = count::<usize>(LAYERS))]
    pub layers: Option<usize>,
    /// What is learned: articulated (the reference simulator's method) or rapier
    #[arg(long, default_value = "articulated", value_parser = word::<Truth>(TRUTHS))]
    pub truth: Truth,
    /// What predictions are added to: state (the paper) or flight (one contact-free frame; the residual form)
    #[arg(long, value_enum, default_value_t = BaseName::State)]
    pub base: BaseName,
    /// NeRD, or one of the designs it is compared with (paper A.3.3)
    #[arg(long, value_enum, default_value_t = Variant::Nerd)]
    pub variant: Variant,
    /// Folder of shards made by `dataset`; recorded in memory if absent
    #[arg(long)]
    pub data: Option<PathBuf>,
    /// Model folder to start from, normaliser and all [default: random weights]
    #[arg(long)]
    pub from: Option<PathBuf>,
    /// Transitions to record
    #[arg(long, value_parser = count::<usize>(TRANSITIONS))]
    pub transitions: Option<usize>,
    /// Frames of a trajectory (paper: 100)
    #[arg(long, default_value_t = 100, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
    /// Transitions recorded while the run goes on, which take the places of the oldest
    #[arg(long, default_value_t = 0, value_parser = count::<usize>(0..=*TRANSITIONS.end()))]
    pub fresh: usize,
    /// Least factor on the random torques, drawn once a trajectory from U(this, 1), below 0 counting as 0 (-1: half of the
    /// trajectories are passive); the paper's data has 1
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true, value_parser = within(-10.0..=1.0))]
    pub torque_scale: f64,
    /// Most frames for which a random action is held, their number drawn once a trajectory; the paper's data has 1
    #[arg(long, default_value_t = 1, value_parser = count::<usize>(FRAMES))]
    pub hold: usize,
    /// Share of the trajectories that start as evaluations and tasks do, not from the box of the data; the paper's data has 0
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub resets: f64,
    /// Folders of policies, comma-separated, that act in part of the data, each in its task
    #[arg(long, value_delimiter = ',')]
    pub policy: Vec<PathBuf>,
    /// Share of the trajectories that policies act in
    #[arg(long, default_value_t = 0.5, requires = "policy", value_parser = share)]
    pub policy_share: f64,
    /// Optimiser updates in the whole run
    #[arg(long, value_parser = count::<u64>(UPDATES))]
    pub updates: Option<u64>,
    /// Windows in an update
    #[arg(long, value_parser = count::<usize>(BATCH))]
    pub batch: Option<usize>,
    /// Learning rate of the first update
    #[arg(long, default_value_t = 1e-3, value_parser = positive)]
    pub rate: f64,
    /// Learning rate the linear decay ends at
    #[arg(long, default_value_t = 1e-4, value_parser = within(0.0..=10.0))]
    pub last_rate: f64,
    /// Share of the run, at its end, over which the rate falls on to zero (paper: 0)
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub tail: f64,
    /// Updates over which the rate rises from zero (paper: 0)
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(0..=*UPDATES.end()))]
    pub warmup: u64,
    /// What updates the hidden matrices: adam (the paper) or muon
    #[arg(long, value_enum, default_value_t = OptimizerName::Adam)]
    pub optimizer: OptimizerName,
    /// Error, in deviations of a target, around which the loss goes over from squares (the paper's) to a straight line
    #[arg(long)]
    pub huber: Option<f32>,
    /// Added to the variance of every target before it is scaled; the paper's lets targets count less that vary by less than
    /// some 3e-3 of their unit [default: the paper's, 1e-5; a run --from a model has its]
    #[arg(long, conflicts_with = "from", value_parser = within(1e-30..=1.0))]
    pub epsilon: Option<f64>,
    /// Decay of the moving average of the weights, per update
    #[arg(long, default_value_t = 0.9995, value_parser = share)]
    pub average: f64,
    /// Updates between validations (default: a fiftieth of the run)
    #[arg(long, value_parser = count::<u64>(0..=*UPDATES.end()))]
    pub validate_every: Option<u64>,
    /// Starts of the rollout evaluation at each validation; its error picks the best weights. 0: the loss does
    #[arg(long, default_value_t = 64, value_parser = count::<usize>(0..=1_000_000))]
    pub rollouts: usize,
    /// Stop, with a checkpoint, after so many minutes; the same command continues
    #[arg(long, value_parser = positive)]
    pub minutes: Option<f64>,
    /// Train no further: make a model of the best weights that the run has had so far
    #[arg(long)]
    pub finish: bool,
    /// Matrix arithmetic on CUDA: f32 throughout instead of TF32
    #[arg(long)]
    pub f32: bool,
    /// Where to compute: cpu or cuda (needs a build with `--features cuda`)
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of data, weights and windows
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
}

impl TrainArgs {
    /// What `reproduce --train` trains: minutes on two cores.
    pub fn small(robot: &str, out: PathBuf, device: Device) -> Self {
        Self {
            robot: robot.into(),
            out,
            preset: Preset::Small,
            history: None,
            stream: false,
            sequence: None,
            epsilon: None,
            embedding: None,
            layers: None,
            truth: Truth::Articulated,
            base: BaseName::State,
            variant: Variant::Nerd,
            data: None,
            from: None,
            transitions: None,
            frames: 100,
            fresh: 0,
            torque_scale: 0.0,
            hold: 1,
            resets: 0.0,
            policy: Vec::new(),
            policy_share: 0.5,
            updates: None,
            batch: None,
            rate: 1e-3,
            last_rate: 1e-4,
            tail: 0.3,
            warmup: 0,
            optimizer: OptimizerName::Muon,
            huber: None,
            average: 0.9995,
            validate_every: None,
            rollouts: 64,
            minutes: None,
            finish: false,
            f32: false,
            device,
            seed: 0,
        }
    }
}

/// Size of network and run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Preset {
    /// E 192, 6 layers, 12 heads, block 32, 10 million transitions, batch 512.
    Paper,
    /// E 48, 2 layers, 4 heads, block 16, 400 000 transitions, batch 128, 6000 updates.
    Small,
    /// Those of a shipped model.
    Shipped(String),
}

impl std::str::FromStr for Preset {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "paper" => Self::Paper,
            "small" => Self::Small,
            name => Self::Shipped(name.into()),
        })
    }
}

/// Optimisers of the hidden matrices.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum OptimizerName {
    /// Adam, as in the paper.
    Adam,
    /// Orthogonalised momentum.
    Muon,
}

/// What predictions are added to.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseName {
    /// The state before the frame.
    State,
    /// The state after a frame without contact, as the truth flies it.
    Flight,
}
