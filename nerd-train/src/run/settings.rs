//! One run's settings. The defaults are the paper's network and training at a tenth of its updates.

use super::*;
use crate::bounds::{BATCH, EMBEDDING, LAYERS, MINUTES, STARTS, TRANSITIONS, UPDATES};

settings! {
    /// One run of training. Files and command lines say it with these keys (`torque-scale` for `torque_scale`).
    pub struct RunConfig {
        ..
        /// Its data; these keys are among the run's own.
        record: RecordConfig;
        /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf or MJCF (.xml)
        robot: String = String::new(), Text;
        /// Folder of the run; the same command continues it
        out: PathBuf = PathBuf::new(), Text;
        /// What predictions are added to: state (the paper) or trapezoid (the state, positions by the mean of the velocities)
        base: Base = Base::State, Words(&["state", "trapezoid"]);
        /// What tokens hold: own (the paper), or moving: also velocities and nearness of contact points, and angles without a seam
        view: View = View::Own, Words(&["own", "moving"]);
        /// Tokens end with what was drawn of their robot: its masses, motors and so on, of a robot with `[vary]`. Without it a network
        /// has to guess them from the frames that it sees
        told: bool = false, Flag;
        /// What moves: nerd, a whole robot, or chain, for cables: rod by rod, through many frames
        variant: Variant = Variant::Nerd, Words(Variant::WORDS);
        /// Width of the network (the paper: 192, or 384)
        embedding: usize = 192, Whole(EMBEDDING);
        /// Layers of the network
        layers: usize = 6, Whole(LAYERS);
        /// Width of an attention head; there are embedding / this many
        head_width: usize = 16, Whole(EMBEDDING);
        /// Tokens of a window: frames that a token sees, itself included; 1 without --stream: a residual network, no attention
        history: usize = 10, Whole(1..=1024);
        /// Rotary positions: rollouts evaluate one token per frame instead of a window
        stream: bool = false, Flag;
        /// Tokens of a training sequence with --stream [default: as many as a prediction of a rollout depends on, 55 with six
        /// layers and windows of 10, and at least 32]; with --history 1 or --variant chain frames of a rollout in training, through
        /// which gradients go back [default: 1]
        sequence: Option<usize> = None, Whole(1..=8192);
        /// Folder of shards made by `dataset`, or recorded motion of anything: the TOML of a log, or its folder (`log.toml`), which
        /// names the robot; recorded in memory if absent
        data: Option<PathBuf> = None, Text;
        /// Trajectories of a log that nothing learns from, comma-separated [default: every fifth, or the last fifth of each]
        held_out: Option<Vec<u64>> = None, Wholes(0..=u64::MAX);
        /// Transitions to record before the run
        transitions: usize = 10_000_000, Whole(TRANSITIONS);
        /// Transitions recorded during the run, which replace the oldest, against overfitting
        fresh: usize = 0, Whole(0..=*TRANSITIONS.end());
        /// Model folder to start from, normaliser and all [default: random weights]
        from: Option<PathBuf> = None, Text;
        /// Optimiser updates in the whole run (the paper: five million)
        updates: u64 = 500_000, Whole(UPDATES);
        /// Windows in an update
        batch: usize = 512, Whole(BATCH);
        /// Learning rate of the first update
        rate: f64 = 1e-3, Positive(10.0);
        /// Learning rate the linear decay ends at
        last_rate: f64 = 1e-4, Number(0.0..=10.0);
        /// Updates over which the rate rises from zero (the paper: 0)
        warmup: u64 = 0, Whole(0..=*UPDATES.end());
        /// What updates the hidden matrices: adam (the paper) or muon
        optimizer: Optimizer = Optimizer::Adam, Words(&["adam", "muon"]);
        /// Error, in standard deviations of a target, at which the pseudo-Huber loss turns from quadratic to linear (the paper: quadratic)
        huber: Option<f32> = None, Positive(1e9);
        /// Added to the variance of every target before it is scaled; with the paper's value, targets that vary by less than about 3e-3 of
        /// their unit count less [default: the paper's, 1e-5; a run --from a model has its]
        epsilon: Option<f64> = None, Number(1e-30..=1.0);
        /// Decay of the moving average of the weights, per update
        average: f64 = 0.9995, Number(0.0..=1.0);
        /// Updates between validations [default: a fiftieth of the run]
        validate_every: Option<u64> = None, Whole(0..=*UPDATES.end());
        /// Windows in a validation
        validation_windows: usize = 16_384, Whole(TRANSITIONS);
        /// Updates between lines of `metrics.jsonl`; each waits for the device
        log_every: u64 = 500, Whole(UPDATES);
        /// Starts of the rollout evaluation at each validation; its error picks the best weights. 0: the loss does
        rollouts: usize = 64, Whole(0..=*STARTS.end());
        /// Stop with a checkpoint after this many minutes; the same command continues
        minutes: Option<f64> = None, Positive(MINUTES);
        /// Stop training and export the best weights so far as a model
        finish: bool = false, Flag;
        /// Where to compute: cpu; cuda, on NVIDIA's cards (needs a build with `--features cuda`); wgpu, on any card (`--features wgpu`);
        /// flex, on the CPU through burn (`--features burn`)
        device: Device = Device::Cpu, Words(Device::WORDS);
        /// Matrix arithmetic on CUDA: f32 throughout instead of TF32
        f32: bool = false, Flag;
    }
}

impl RunConfig {
    /// The paper's for a robot.
    pub fn new(robot: &str, out: impl Into<PathBuf>) -> Self {
        Self { robot: robot.into(), out: out.into(), ..Self::default() }
    }
}

/// What a run's network moves: a robot, or a cable rod by rod.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// The paper's: a token of the whole robot a frame.
    #[default]
    Nerd,
    /// Rods of a chain as tokens, learned through many frames ([`crate::unroll`]).
    Chain,
}

impl Variant {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["nerd", "chain"];

    /// Whether it is NeRD itself.
    pub fn usual(&self) -> bool {
        *self == Self::Nerd
    }

    /// In a title.
    pub fn name(self) -> &'static str {
        if self == Self::Chain { "NeRD along the chain" } else { "NeRD" }
    }
}
