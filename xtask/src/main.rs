//! `cargo xtask VERB`: one file per verb. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Command, CommandFactory, FromArgMatches, Parser};

/// Standard `println!` panics where nobody reads.
macro_rules! println {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}

mod ablations;
mod campaign;
mod chart;
mod check;
mod common;
mod dataset;
mod evaluate;
mod files;
mod flags;
mod gif;
mod grow;
mod horizons;
mod inspect;
mod keys;
mod numbers;
mod out;
mod policy;
mod report;
mod reproduce;
mod results;
mod rollout;
mod solvers;
mod stability;
mod stamp;
mod sweep;
mod tosses;
mod train;
mod urdf;

/// Moved to the libraries; the verbs name them there as they move, too.
mod moved {
    pub mod paper {
        pub use nerd_train::paper::*;
    }
    pub mod plot {
        pub use nerd_train::report::plot::*;
    }
    pub mod provenance {
        pub use nerd_train::report::provenance::*;
    }
    pub mod sessions {
        pub use nerd_train::sessions::*;
    }
    pub mod table {
        pub use nerd_train::report::table::*;
    }
    pub mod truth {
        pub use nerd_sim::truth::Truth;
    }
}
use moved::{paper, plot, provenance, sessions, table, truth};

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", version, about)]
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
    Chart(chart::ChartArgs),
    /// Time a frame of arms of more and more links, analytic and learned
    Grow(grow::GrowArgs),
    /// The main job: tables and charts of the shipped models
    Reproduce(reproduce::ReproduceArgs),
    /// Say which results still hold, make them anew, write their figures into the documents
    Results(results::ResultsArgs),
    /// Write one page with everything: tables, charts, maps, replays
    Report(report::ReportArgs),
    /// Draw the moving picture of README
    Gif(gif::GifArgs),
    /// Train, evaluate or show a policy
    Policy(policy::PolicyArgs),
    /// Show where each method stays right, bends and breaks
    Stability(stability::StabilityArgs),
    /// Predict real tosses of a cube, open loop
    Tosses(tosses::TossesArgs),
    /// Write into models which robot and which weights they are of, for `Model::load` to hold them to
    Stamp(stamp::StampArgs),
    /// Read every URDF of a folder and roll it out, or say what it asks for that is not there
    Urdf(urdf::UrdfArgs),
    /// Try hostile input: files and command lines changed at random, runs killed
    Campaign(campaign::CampaignArgs),
    /// Format, clippy, docs, tests
    Check(check::CheckArgs),
}

fn parse() -> Result<Verb, clap::Error> {
    let mut command = negatives(Verb::command());
    let matches = command.try_get_matches_from_mut(std::env::args_os())?;
    Verb::from_arg_matches(&matches).map_err(|e| e.format(&mut command))
}

/// A number below zero behind an option is its value, for the option to refuse by its range.
fn negatives(command: Command) -> Command {
    let options = command.mut_args(|arg| {
        let valued = !arg.is_positional() && arg.get_action().takes_values();
        arg.allow_negative_numbers(valued)
    });
    options.mut_subcommands(negatives)
}

fn main() -> ExitCode {
    let verb = match parse() {
        Ok(verb) => verb,
        // Asked for help, or for nothing at all: the list of verbs.
        Err(error) if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => error.exit(),
        Err(error) => {
            // clap's message without its usage, on one line.
            let text = error.to_string();
            let words = text.lines().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more")).flat_map(str::split_whitespace);
            eprintln!("{}", words.collect::<Vec<_>>().join(" "));
            return ExitCode::from(2);
        }
    };
    provenance::Provenance::begin();
    let done = match verb {
        Verb::Dataset(args) => dataset::run(args),
        Verb::Inspect(args) => inspect::run(args),
        Verb::Train(args) => train::run(*args),
        Verb::Rollout(args) => rollout::run(args),
        Verb::Evaluate(args) => evaluate::run(args),
        Verb::Chart(args) => chart::run(args),
        Verb::Grow(args) => grow::run(args),
        Verb::Reproduce(args) => reproduce::run(args),
        Verb::Results(args) => results::run(args),
        Verb::Report(args) => report::run(args),
        Verb::Gif(args) => gif::run(args),
        Verb::Policy(args) => policy::run(args),
        Verb::Stability(args) => stability::run(args),
        Verb::Tosses(args) => tosses::run(args),
        Verb::Stamp(args) => stamp::run(args),
        Verb::Urdf(args) => urdf::run(args),
        Verb::Campaign(args) => campaign::run(args),
        Verb::Check(args) => check::run(args),
    };
    match done.and_then(|()| out::check()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Many errors already say their cause.
            let said =
                error.chain().map(ToString::to_string).reduce(|all, cause| if all.contains(&cause) { all } else { all + ": " + &cause });
            eprintln!("error: {}", brief(&said.unwrap_or_default().replace('\n', " ")));
            ExitCode::from(2)
        }
    }
}

/// The words of an error without the middle of what nobody would read: it may quote a whole file.
fn brief(words: &str) -> String {
    const MOST: usize = 2000;
    let n = words.chars().count();
    if n <= MOST {
        return words.into();
    }
    let (start, end) = (words.chars().take(MOST - 500), words.chars().skip(n - 500));
    start.chain(" [..] ".chars()).chain(end).collect()
}
