//! `cargo xtask dataset --robot pendulum --out data/pendulum`: random trajectories of a truth as safetensors shards.
//!
//! Starts from the robot's sampling box, a random plane where it has one, fresh random torques every frame. A shard is
//! there whole or not at all; the same command again keeps what is there and makes what is missing. One process at a time
//! writes into a folder.

use std::path::PathBuf;

use anyhow::{Context, Result};
use nerd_sim::dataset::{GenerateConfig, generate};
use nerd_sim::law::Law;
use nerd_sim::prelude::*;

use crate::common::{TRUTHS, word};
use crate::numbers::{self, FRAMES, SEEDS, TRANSITIONS, count, share};
use crate::truth::Truth;

/// Record random trajectories.
#[derive(clap::Args, Clone, Debug)]
pub struct DatasetArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, anymal-paper, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// What is recorded: articulated (the reference simulator's method) or rapier
    #[arg(long, default_value = "articulated", value_parser = word::<Truth>(TRUTHS))]
    pub truth: Truth,
    /// Transitions in all, rounded up to whole trajectories
    #[arg(long, default_value_t = 1_000_000, value_parser = count::<usize>(TRANSITIONS))]
    pub transitions: usize,
    /// Frames of a trajectory
    #[arg(long, default_value_t = 100, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
    /// Least factor on the random torques, drawn once a trajectory from U(this, 1)
    #[arg(long, default_value_t = 1.0, value_parser = share)]
    pub torque_scale: f64,
    /// Most frames for which a random action is held, their number drawn once a trajectory
    #[arg(long, default_value_t = 1, value_parser = count::<usize>(FRAMES))]
    pub hold: usize,
    /// Share of the trajectories that start as evaluations and tasks do, not from the box of the data
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub resets: f64,
    /// Seed (the paper: 0 to train, 10 to validate)
    #[arg(long, default_value_t = 0, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder of the shards
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// Runs the verb.
pub fn run(args: DatasetArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let torque_scale = Law { low: args.torque_scale, high: 1.0 };
    let DatasetArgs { transitions, frames, seed, hold, resets, .. } = args;
    let config = GenerateConfig { transitions, frames, seed, torque_scale, hold, resets, ..Default::default() };
    // A shard is recorded, turned into bytes and written: three times its numbers.
    let (robot, trajectories) = (&system.robot, config.trajectories().min(config.shard_trajectories));
    let row = robot.state_dim() + robot.joint_count() + 7 * robot.contact_points.len();
    numbers::memory(&[("trajectories of a shard", trajectories), ("--frames", frames)], 24 * row)?;
    numbers::time(&[("--transitions", transitions), ("substeps", system.spec.substeps)])?;
    // Of two processes with one --out the second is refused: each would leave shards of its own.
    let _claim = nerd_sim::files::claim(&args.out).context("--out")?;
    let started = std::time::Instant::now();
    let bar = crate::common::bar("transitions", (config.trajectories() * config.frames) as u64);
    let mut solver = args.truth.solver(&system);
    let manifest = generate(&system, &mut *solver, &args.truth.name(), &config, &args.out, &mut |done, _| bar.set(done as u64))?;
    bar.finish();
    let (n, seconds) = (manifest.trajectories * manifest.frames, started.elapsed().as_secs_f64());
    println!(
        "{n} transitions in {} shards, {seconds:.1} s, {:.0} transitions/s, sha256 {}",
        manifest.shards.len(),
        n as f64 / seconds,
        manifest.sha256
    );
    Ok(())
}
