//! Settings of a run. The defaults are the paper's network and training, with a tenth of its updates.

use super::*;
use crate::bounds::{BATCH, EMBEDDING, LAYERS, MINUTES, STARTS, TRANSITIONS, UPDATES};

settings! {
    /// Settings of a training run. In files and on command lines, keys have dashes (`torque-scale` for `torque_scale`).
    pub struct RunConfig {
        ..
        /// Settings of the recording; the keys are on the same level.
        record: RecordConfig;
        # "Run"
        /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable
        /// .toml
        robot: String = String::new(), Text;
        /// Folder of the run; the same command continues the run
        out: PathBuf = PathBuf::new(), Text, "FOLDER";
        /// Minutes after which training stops with a checkpoint; the same command continues [default: no limit]
        minutes: Option<f64> = None, Positive(MINUTES);
        /// Stops training and exports the best weights so far as a model
        finish: bool = false, Flag;
        # "Network"
        /// Learned system: nerd (one token per frame for the whole robot) or chain (one token per rod of a cable)
        variant: Variant = Variant::Nerd, Words(Variant::WORDS);
        /// Base of the predictions: state (the paper), or trapezoid (positions advanced by the mean of old and new
        /// velocities)
        base: Base = Base::State, Words(&["state", "trapezoid"]);
        /// Content of tokens: own (the paper), or moving (also velocities and nearness of contact points, link axes,
        /// sines and cosines)
        view: View = View::Own, Words(&["own", "moving"]);
        /// Conditions the model on the robot's parameters (masses, actuators, ...), for robots with `[vary]`. Tokens
        /// then end with the drawn parameters. Without it, the network infers them from the frames
        condition_on_params: bool = false, Flag;
        /// Width of the network (the paper: 192 or 384)
        embedding: usize = 192, Whole(EMBEDDING), "WIDTH";
        /// Number of layers of the network
        layers: usize = 6, Whole(LAYERS), "N";
        /// Frames of a window: a token attends to this many, itself included. With 1 and without --stream, the network
        /// is residual and has no attention
        history: usize = 10, Whole(1..=1024), "FRAMES";
        /// Width of an attention head. The number of heads is --embedding divided by this
        head_width: usize = 16, Whole(EMBEDDING), "WIDTH";
        /// Uses rotary positions, so that a rollout evaluates one token per frame. Without it, every frame evaluates a
        /// whole window
        stream: bool = false, Flag;
        # "Data"
        /// Training data: a folder of shards from `dataset`, or recorded motion (a log's TOML, or a folder with
        /// `log.toml`). A log names the robot. Without it, trajectories are recorded in memory
        data: Option<PathBuf> = None, Text, "FOLDER|LOG";
        /// Trajectories of the log that are held out from training, by number, comma-separated [default: every fifth,
        /// or the last fifth of each of fewer than five]
        held_out: Option<Vec<u64>> = None, Wholes(0..=u64::MAX), "NUMBERS";
        /// Number of transitions to record before training
        transitions: usize = 10_000_000, Whole(TRANSITIONS), "N";
        /// Number of transitions to record during training. They replace the oldest, against overfitting; 0 records
        /// none
        fresh_transitions: usize = 0, Whole(0..=*TRANSITIONS.end()), "TRANSITIONS";
        # "Training"
        /// Folder of a model to start from, with its weights and normaliser [default: random weights]
        from: Option<PathBuf> = None, Text, "FOLDER";
        /// With --stream: tokens of a training sequence. With --history 1 or --variant chain: frames of a training
        /// rollout, through which gradients flow [default: 1; with --stream the frames that a prediction depends on, at
        /// least 32]
        sequence: Option<usize> = None, Whole(1..=8192), "N";
        /// Optimiser updates in the whole run (the paper: five million)
        updates: u64 = 500_000, Whole(UPDATES), "N";
        /// Windows in an update (the paper: 512)
        batch: usize = 512, Whole(BATCH), "WINDOWS";
        /// Learning rate of the first update
        learning_rate: f64 = 1e-3, Positive(10.0);
        /// Learning rate at the end of the linear decay
        final_learning_rate: f64 = 1e-4, Number(0.0..=10.0), "RATE";
        /// Updates over which the learning rate rises from 0 (the paper: 0)
        warmup: u64 = 0, Whole(0..=*UPDATES.end()), "UPDATES";
        /// Optimiser of the hidden matrices: adam (the paper) or muon. Adam updates all other parameters
        optimizer: Optimizer = Optimizer::Adam, Words(&["adam", "muon"]);
        /// Error, in standard deviations of a target, where the pseudo-Huber loss turns from quadratic to linear
        /// [default: quadratic loss, as in the paper]
        huber: Option<f32> = None, Positive(1e9), "DEVIATIONS";
        /// Added to the variance of every target before scaling. With 1e-5, targets that vary by less than 3e-3 of
        /// their unit weigh less [default: 1e-5, the paper's; with --from the model's]
        epsilon: Option<f64> = None, Number(1e-30..=1.0), "VARIANCE";
        /// Decay per update of the moving average of the weights (the paper: 0, no average)
        average: f64 = 0.9995, Number(0.0..=1.0), "DECAY";
        # "Validation"
        /// Updates between validations [default: a fiftieth of the run]
        validate_every: Option<u64> = None, Whole(0..=*UPDATES.end()), "UPDATES";
        /// Windows in a validation
        validation_windows: usize = 16_384, Whole(TRANSITIONS), "WINDOWS";
        /// Starts of the rollouts in a validation. Their error selects the best weights; with 0, the validation loss
        /// does
        rollouts: usize = 64, Whole(0..=*STARTS.end()), "STARTS";
        /// Updates between lines of `metrics.jsonl`. Each line waits for the device
        log_every: u64 = 500, Whole(UPDATES), "UPDATES";
        # "Device"
        /// Device that trains: cpu, cuda (NVIDIA GPU), wgpu (any GPU) or flex (the CPU through burn). The last three
        /// need a build with `--features cuda`, `wgpu` or `burn`. cuda-f32 is refused: use cuda with --f32
        device: Device = Device::Cpu, Words(Device::WORDS);
        /// With --device cuda: computes matrix products in f32. Without it, they use TF32
        f32: bool = false, Flag;
    }
}

impl RunConfig {
    /// The paper's settings for a robot, with the run's folder `out`.
    pub fn new(robot: &str, out: impl Into<PathBuf>) -> Self {
        Self { robot: robot.into(), out: out.into(), ..Self::default() }
    }
}

/// Kind of learned system: a whole robot, or a cable rod by rod.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The paper's: one token of the whole robot per frame.
    #[default]
    Nerd,
    /// Rods of a chain as tokens, trained through rollouts ([`crate::unroll`]).
    Chain,
}

impl Variant {
    /// Names on the command line and in serde, in the order of the variants.
    pub const WORDS: &[&str] = &["nerd", "chain"];

    /// Whether the variant is NeRD.
    pub fn usual(&self) -> bool {
        *self == Self::Nerd
    }

    /// Name in a title.
    pub fn name(self) -> &'static str {
        if self == Self::Chain { "NeRD along the chain" } else { "NeRD" }
    }
}
