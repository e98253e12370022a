//! `cargo xtask VERB`: one file per verb. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::process::ExitCode;

use clap::{Command, CommandFactory, FromArgMatches, Parser};
use nerd_train::provenance::Provenance;

// Standard `println!` and `eprintln!` panic where nobody reads.
macro_rules! println {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}
macro_rules! eprintln {
    ($($text:tt)*) => { nerd_train::progress::tell(format_args!($($text)*)) };
}

mod campaign;
mod check;
mod common;
mod completions;
mod conduct;
mod crowd;
mod dataset;
mod evaluate;
mod files;
mod flags;
mod inspect;
mod keys;
mod list;
mod measure;
mod numbers;
mod out;
mod outside;
mod policy;
mod ranks;
mod reference;
mod refusals;
mod report;
mod reproduce;
mod results;
mod rollout;
mod solvers;
mod stability;
mod stamp;
mod stand;
mod train;
mod urdf;
mod verbs;

/// Read by NCCL.
const MULTICAST: &str = "NCCL_NVLS_ENABLE";

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
enum Verb {
    /// Record random trajectories as safetensors shards
    Dataset(dataset::DatasetArgs),
    /// Show what a data set holds, as a learner will see it
    Inspect(inspect::InspectArgs),
    /// Train a model from nothing, or go on training
    Train(Box<train::TrainArgs>),
    /// Roll a solver out from the states of a CSV file
    Rollout(rollout::RolloutArgs),
    /// Measure how far a solver drifts from the truth
    Evaluate(evaluate::EvaluateArgs),
    /// Draw speed against accuracy of every solver of a scene
    Chart(conduct::ConductArgs<nerd_lab::experiments::chart::Chart>),
    /// Measure an experiment of the laboratory
    Measure(measure::MeasureArgs),
    /// The main job: tables and charts of the shipped models
    Reproduce(reproduce::ReproduceArgs),
    /// Say which results still hold, make them anew, write their figures into the documents
    Results(results::ResultsArgs),
    /// Write one page with everything: tables, charts, maps, replays
    Report(report::ReportArgs),
    /// Train, evaluate or show a policy
    Policy(policy::PolicyArgs),
    /// Show where each method stays right, bends and breaks
    Stability(stability::StabilityArgs),
    /// Fit parameters of robot, contact and scene to measured trajectories, and judge them on others
    Calibrate(conduct::ConductArgs<nerd_lab::experiments::calibrated::Calibration>),
    /// Write into models which robot and which weights they are of, for `Model::load` to hold them to
    Stamp(stamp::StampArgs),
    /// Read every URDF of a folder and roll it out, or say what it asks for that is not there
    Urdf(urdf::UrdfArgs),
    /// Show robots, scenes, tasks, models, rows: what can be named here
    List(list::ListArgs),
    /// Print completions for bash, zsh or fish
    Completions(completions::CompletionsArgs),
    /// Write the reference of all commands
    Reference(reference::ReferenceArgs),
    /// Try hostile input: files and command lines changed at random, runs killed
    Campaign(campaign::CampaignArgs),
    /// Build the packages of `examples/` from nothing, and count what they stand on
    Outside(outside::OutsideArgs),
    /// Format, clippy, docs, tests
    Check(check::CheckArgs),
}

/// The command line.
fn program() -> Command {
    verbs::prepare(Verb::command())
}

fn parse() -> Result<Verb, clap::Error> {
    let mut program = program();
    let matches = program.try_get_matches_from_mut(std::env::args_os())?;
    if verbs::as_json(&matches) {
        out::json();
    }
    Verb::from_arg_matches(&matches).map_err(|e| e.format(&mut program))
}

fn main() -> ExitCode {
    // Sums of several graphics cards go without NVLink's multicast, which not every machine has set up, unless somebody asks for it.
    if std::env::var_os(MULTICAST).is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var(MULTICAST, "0") };
    }
    let verb = match parse() {
        Ok(verb) => verb,
        Err(error) => return refusals::unsaid(&error),
    };
    Provenance::begin();
    let done = match verb {
        Verb::Dataset(args) => dataset::run(args),
        Verb::Inspect(args) => inspect::run(args),
        Verb::Train(args) => train::run(*args),
        Verb::Rollout(args) => rollout::run(args),
        Verb::Evaluate(args) => evaluate::run(args),
        Verb::Chart(args) => args.run(),
        Verb::Measure(args) => measure::run(args),
        Verb::Reproduce(args) => reproduce::run(args),
        Verb::Results(args) => results::run(args),
        Verb::Report(args) => report::run(args),
        Verb::Policy(args) => policy::run(args),
        Verb::Stability(args) => stability::run(args),
        Verb::Calibrate(args) => args.run(),
        Verb::Stamp(args) => stamp::run(args),
        Verb::Urdf(args) => urdf::run(args),
        Verb::List(args) => list::run(args),
        Verb::Completions(args) => completions::run(args),
        Verb::Reference(args) => reference::run(args),
        Verb::Campaign(args) => campaign::run(args),
        Verb::Outside(args) => outside::run(args),
        Verb::Check(args) => check::run(args),
    };
    match done.and_then(|()| out::finish()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => refusals::end(&refusals::failure(&error)),
    }
}
