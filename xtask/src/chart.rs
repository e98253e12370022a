//! `cargo xtask chart --robot pendulum --scene ground1`: every solver of a scene on one picture, by speed and accuracy
//! ([`nerd_lab::experiments::chart`]). Some minutes on one core.

use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::experiments::chart::{Chart, ChartSettings};
use nerd_train::shipped::results;

use crate::numbers::{FRAMES, SEEDS, STARTS, SUBSTEPS, count};

/// Draw speed against accuracy.
#[derive(clap::Args, Clone, Debug)]
pub struct ChartArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Scene: free, a scene of the robot (ground, or ground1 .. ground6 for the pendulum), plane, slope, box, steps, hills
    #[arg(long, default_value = "free")]
    pub scene: String,
    /// Model folders, comma-separated [default: all of the robot in models/]
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Trajectories
    #[arg(long, default_value_t = 64, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames over which the error is the mean
    #[arg(long, default_value_t = 100, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
    /// Largest number of substeps
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(SUBSTEPS))]
    pub substeps: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Python that has MuJoCo, to draw that engine too [default if no value is given: python3]
    #[arg(long, value_name = "PYTHON", num_args = 0..=1, default_missing_value = "python3")]
    pub mujoco: Option<PathBuf>,
    /// Folder for chart-ROBOT-SCENE.json, .md, .svg and .png [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: ChartArgs) -> Result<()> {
    let ChartArgs { robot, scene, model, starts, frames, substeps, seed, mujoco, out } = args;
    crate::out::conduct(
        &Chart::new(ChartSettings { robot, scene, models: model, starts, horizon: frames, substeps, seed, mujoco })?,
        &out.unwrap_or_else(results),
    )
}
