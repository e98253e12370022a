//! One file per verb: parse, call, print.

mod check_robots;
mod dataset;
mod evaluate;
mod inspect;
pub mod list;
mod live;
mod policy;
mod rollout;
mod train;

use anyhow::Result;
use clap::{Parser, Subcommand};

use crate::{call::Program, conduct::Conduct, experiments::calibrated::Calibration};

/// The verbs that need no checkout, but for `list`.
#[derive(Subcommand)]
pub enum Verb {
    /// Record random trajectories as safetensors shards
    Dataset(dataset::DatasetArgs),
    /// Print the full specification of a robot, with derived values
    Inspect(inspect::InspectArgs),
    /// Train a model, or continue a run
    Train(Box<train::TrainArgs>),
    /// Roll out a solver from the states of a CSV file
    Rollout(rollout::RolloutArgs),
    /// Measure how far a solver drifts from the truth
    Evaluate(evaluate::EvaluateArgs),
    /// Train, evaluate, show or export policies
    #[command(subcommand)]
    Policy(policy::PolicyVerb),
    /// Fit parameters of robot, contact and scene to measured trajectories, and test the fit on others
    Calibrate(Conduct<Calibration>),
    /// Read URDF and MJCF files, roll each robot out, and report unsupported features
    CheckRobots(check_robots::CheckRobotsArgs),
    /// Serve a page with a robot in real time, to push it and to swap its solver
    Live(live::LiveArgs),
}

impl Verb {
    pub fn run(self) -> Result<()> {
        match self {
            Self::Dataset(args) => dataset::run(args),
            Self::Inspect(args) => inspect::run(args),
            Self::Train(args) => train::run(*args),
            Self::Rollout(args) => rollout::run(args),
            Self::Evaluate(args) => evaluate::run(args),
            Self::Policy(args) => policy::run(args),
            Self::Calibrate(args) => args.run(),
            Self::CheckRobots(args) => check_robots::run(args),
            Self::Live(args) => live::run(args),
        }
    }
}

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "python -m nerd", bin_name = "python -m nerd", version)]
pub enum Package {
    #[command(flatten)]
    Verb(Verb),
    /// List robots, scenes, tasks or models
    #[command(subcommand)]
    List(list::What),
}

impl Program for Package {
    fn run(self) -> Result<()> {
        match self {
            Self::Verb(verb) => verb.run(),
            Self::List(what) => list::run(what),
        }
    }
}
