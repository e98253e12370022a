//! What is asked for.

use std::path::PathBuf;

use nerd_train::bounds::{SEEDS, STARTS, SUBSTEPS};
use nerd_train::settings::settings;

settings! {
    /// Solvers and training on a graphics card.
    pub struct Benchmark {
        /// Name of the result
        name: String = "benchmark".into(), Text;
        /// Robots with their scenes, ROBOT:SCENE, comma-separated
        robots: Vec<String> = ["pendulum:ground1", "cube:ground", "ant:ground", "anymal:ground", "franka:free"].map(String::from).into(), Texts;
        /// Rollouts whose error is measured
        rollouts: usize = 256, Whole(STARTS);
        /// Environments of the timed batch, and of training
        environments: usize = 8192, Whole(STARTS);
        /// Substeps of the implicit step, comma-separated
        substeps: Vec<usize> = vec![1, 2, 4, 8, 16, 32], Wholes(SUBSTEPS);
        /// Substeps of the explicit step, of Runge-Kutta where nothing touches, comma-separated
        explicit: Vec<usize> = vec![16, 64, 256], Wholes(SUBSTEPS);
        /// Tasks whose training is timed, in the models of their robots and in four implicit substeps, comma-separated [default: none]
        tasks: Vec<String> = Vec::new(), Texts;
        /// Python that has MuJoCo Warp, to measure that engine too [default: none]
        warp: Option<PathBuf> = None, Text;
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}
