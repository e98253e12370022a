//! What is asked for.

use nerd_train::bounds::{SEEDS, STARTS, TRANSITIONS, UPDATES};
use nerd_train::device::Device;
use nerd_train::settings::settings;

/// Windows in an update of NeRD.
pub(super) const BATCH: usize = 64;

settings! {
    /// The paper's ablations (Figure A.2).
    pub struct Ablations {
        /// Robots, comma-separated [default: pendulum,ant]
        robot: Vec<String> = vec!["pendulum".into(), "ant".into()], Texts;
        /// Variants beside NeRD, comma-separated, as their bars are called (`gru`, `abs-pred`, `h-1`) [default: all]
        only: Vec<String> = Vec::new(), Texts;
        /// Optimiser updates of each variant
        updates: u64 = 1200, Whole(UPDATES);
        /// Transitions of the training data
        transitions: usize = 200_000, Whole(TRANSITIONS);
        /// Trajectories of the evaluation (the paper: 2048)
        starts: usize = 256, Whole(STARTS);
        /// Games of each running policy (the paper: 2048)
        games: usize = 128, Whole(STARTS);
        /// Seeds of data, weights and windows, comma-separated; bars are means over them [default: 0]
        seed: Vec<u64> = vec![0], Wholes(SEEDS);
        /// Where to compute: cpu or cuda
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

/// Frames of a rollout: those of the paper's first test case; of the Ant, which sooner knows no more than one who repeats the
/// start after so short a training, a third of a second.
pub(super) fn frames(robot: &str) -> usize {
    if robot == "ant" { 20 } else { 100 }
}
