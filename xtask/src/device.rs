//! `cargo xtask device`: solvers on a GPU beside the CPU's (`nerd_lab::experiments::device`, with the feature `cuda`).

use std::path::PathBuf;

use anyhow::Result;

use crate::numbers::{SEEDS, STARTS, SUBSTEPS, count};

/// Speed against accuracy on a GPU, and parity with the CPU: the articulated solver, models, MuJoCo Warp (needs a build with `--features cuda`).
#[derive(clap::Args, Clone, Debug)]
#[cfg_attr(not(feature = "cuda"), allow(dead_code))]
pub struct DeviceArgs {
    /// Robots with their scenes, ROBOT:SCENE, comma-separated
    #[arg(
        long,
        value_delimiter = ',',
        num_args = 0..,
        default_value = "pendulum:ground1,cube:ground,ant:ground,anymal:ground,franka:free",
        value_name = "ROBOT:SCENE"
    )]
    pub robots: Vec<String>,
    /// States from which one frame is compared
    #[arg(long, default_value_t = 4096, value_parser = count::<usize>(STARTS))]
    pub states: usize,
    /// Rollouts whose error is measured
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(STARTS))]
    pub rollouts: usize,
    /// Environments of the timed batch
    #[arg(long, default_value_t = 8192, value_parser = count::<usize>(STARTS))]
    pub environments: usize,
    /// Substeps of the implicit step, comma-separated
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2, 4, 8, 16, 32], value_parser = count::<usize>(SUBSTEPS))]
    pub substeps: Vec<usize>,
    /// Substeps of the explicit step, of Runge-Kutta where nothing touches, comma-separated
    #[arg(long, value_delimiter = ',', default_values_t = [16, 64, 256], value_parser = count::<usize>(SUBSTEPS))]
    pub explicit: Vec<usize>,
    /// Model folders [default: those that come with the project]
    #[arg(long, value_delimiter = ',', value_name = "FOLDER")]
    pub models: Vec<PathBuf>,
    /// Tasks whose training is timed, comma-separated; without one, none is
    #[arg(long, value_delimiter = ',', num_args = 0.., default_value = "cartpole-swingup,franka-reach,ant-run,anymal-forward")]
    pub tasks: Vec<String>,
    /// Substeps of implicit steps in which tasks are learned and timed, too, comma-separated; without one, none is
    #[arg(long, value_delimiter = ',', num_args = 0.., default_values_t = [4], value_parser = count::<usize>(SUBSTEPS))]
    pub beside: Vec<usize>,
    /// Tasks that are learned for so many seconds and then played in the truth, TASK:SECONDS, comma-separated; without one, none is
    #[arg(long, value_delimiter = ',', num_args = 0.., default_value = "ant-run:60,anymal-forward:90", value_name = "TASK:SECONDS")]
    pub races: Vec<String>,
    /// Seeds of these, comma-separated
    #[arg(long, value_delimiter = ',', default_values_t = [310, 311, 312], value_parser = count::<u64>(SEEDS))]
    pub seeds: Vec<u64>,
    /// Folder of their runs
    #[arg(long, default_value = "out/races", value_name = "FOLDER")]
    pub runs: PathBuf,
    /// Python that has MuJoCo Warp, to ask that engine in
    #[arg(long, value_name = "PYTHON")]
    pub warp: Option<PathBuf>,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Name of the files
    #[arg(long, default_value = "device", value_name = "NAME")]
    pub name: String,
    /// Folder for NAME.json and .md [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
#[cfg(feature = "cuda")]
pub fn run(args: DeviceArgs) -> Result<()> {
    let DeviceArgs {
        robots,
        states,
        rollouts,
        environments,
        substeps,
        explicit,
        models,
        tasks,
        beside,
        races,
        seeds,
        runs,
        warp,
        seed,
        name,
        out,
    } = args;
    let pair = |text: &String| {
        let (robot, scene) =
            text.split_once(':').ok_or_else(|| anyhow::anyhow!("--robots {text}: write ROBOT:SCENE, for example ant:ground"))?;
        Ok((robot.to_string(), scene.to_string()))
    };
    let robots = robots.iter().map(pair).collect::<Result<Vec<_>>>()?;
    let race = |text: &String| {
        let found = text.split_once(':').and_then(|(task, seconds)| Some((task.to_string(), seconds.parse::<f64>().ok()?)));
        let fits = found.filter(|(_, seconds)| *seconds > 0.0 && *seconds < 1e6);
        fits.ok_or_else(|| anyhow::anyhow!("--races {text}: write TASK:SECONDS, for example ant-run:60"))
    };
    let races = races.iter().map(race).collect::<Result<Vec<_>>>()?;
    let experiment = nerd_lab::experiments::device::OnDevice {
        name,
        robots,
        models,
        states,
        rollouts,
        environments,
        substeps: [substeps, explicit],
        tasks,
        beside: beside.into_iter().map(nerd_model::pick::Setting::Implicit).collect(),
        races,
        seeds,
        runs,
        warp,
        seed,
    };
    crate::out::conduct(&experiment, &out.unwrap_or_else(nerd_train::shipped::results))
}

/// Says what it takes.
#[cfg(not(feature = "cuda"))]
pub fn run(_: DeviceArgs) -> Result<()> {
    anyhow::bail!("this needs a build with `--features cuda`: cargo run --release -p xtask --features cuda -- device")
}
