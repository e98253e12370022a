//! Who races, for how long, and what is to be reached.

use crate::prelude::*;

/// Seconds after which a policy is set aside.
pub(super) const AT: [f64; 17] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 120.0];

/// Rewards that are to be reached.
pub(super) const GOALS: [(&str, f64); 4] =
    [("cartpole-swingup", 1100.0), ("ant-run", 3000.0), ("ant-spin-track", 2000.0), ("anymal-forward", 1400.0)];

settings! {
    /// Policies that learn against the clock.
    pub struct Race {
        /// Name of the result
        name: String = "race".into(), Text;
        /// Tasks, comma-separated
        task: Vec<String> = GOALS.map(|goal| goal.0.to_string()).into(), Texts;
        /// Who races, comma-separated: ppo or shac, a hyphen, and where it learns: neural (the model that comes with the project), truth, or x1, x4
        /// and so on (articulated with so many substeps)
        entrant: Vec<String> = ["ppo-neural", "shac-neural", "ppo-x4", "shac-x4"].map(String::from).into(), Texts;
        /// Seeds, comma-separated: each makes a run of every entrant and task
        seeds: Vec<u64> = vec![0, 1, 2], Wholes(SEEDS);
        /// Seconds that a run has
        seconds: f64 = 60.0, Positive;
        /// Environments, instead of the settings'
        environments: Option<usize> = None, Whole(1..=1_048_576);
        /// Iterations of shac, over which its rate falls, instead of the settings'
        iterations: Option<u64> = None, Whole(1..=1_000_000_000);
        /// Folder of TOMLs that go before the project's own settings: TASK-ALGORITHM.toml
        settings: Option<PathBuf> = None, Text;
        /// Games of each policy in the truth; with 0 runs are made, and a later command plays
        games: usize = 64, Whole(0..=65_536);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Where runs are computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// Folder of the runs
        runs: PathBuf = "out/race".into(), Text;
    }
}
