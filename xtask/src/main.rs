//! `cargo xtask VERB`: one file per verb. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::process::ExitCode;

use clap::Parser;

mod check;
mod common;
mod dataset;
mod evaluate;
mod files;
mod paper;
mod provenance;
mod rollout;
mod solvers;
mod table;
mod train;

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", version, about)]
enum Verb {
    /// Record random trajectories as safetensors shards
    Dataset(dataset::DatasetArgs),
    /// Train a model from nothing, or go on training
    Train(Box<train::TrainArgs>),
    /// Roll a solver out from the states of a CSV file
    Rollout(rollout::RolloutArgs),
    /// Measure how far a solver drifts from the truth
    Evaluate(evaluate::EvaluateArgs),
    /// Format, clippy, docs, tests
    Check(check::CheckArgs),
}

fn main() -> ExitCode {
    let done = match Verb::parse() {
        Verb::Dataset(args) => dataset::run(args),
        Verb::Train(args) => train::run(*args),
        Verb::Rollout(args) => rollout::run(args),
        Verb::Evaluate(args) => evaluate::run(args),
        Verb::Check(args) => check::run(args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", format!("{error:#}").replace('\n', " "));
            ExitCode::from(2)
        }
    }
}
