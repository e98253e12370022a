//! `cargo xtask VERB`: one file per verb. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::error::Error;
use std::ffi::OsString;

use anyhow::Result;
use clap::{Command, CommandFactory, FromArgMatches, Parser, error::ErrorKind};
use nerd_lab::{experiments::calibrated::Calibration, experiments::chart::Chart};
use nerd_train::provenance::Provenance;

#[macro_use(tell)]
extern crate nerd_train;

/// A line on standard output. The standard `println!` panics on a closed pipe.
macro_rules! say {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}

mod campaign;
mod check;
mod commands;
mod dataset;
mod evaluate;
mod inspect;
mod list;
mod live;
mod measure;
mod options;
mod out;
mod policy;
mod prelude;
mod refusals;
mod report;
mod reproduce;
mod results;
mod rollout;
mod signals;
mod solvers;
mod stability;
mod train;
mod urdf;

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
enum Verb {
    /// Record random trajectories as safetensors shards
    Dataset(dataset::DatasetArgs),
    /// Show what is known of a robot, and what was derived
    Inspect(inspect::InspectArgs),
    /// Train a model, or continue a run
    Train(Box<train::TrainArgs>),
    /// Roll a solver out from the states of a CSV file
    Rollout(rollout::RolloutArgs),
    /// Measure how far a solver drifts from the truth
    Evaluate(evaluate::EvaluateArgs),
    /// Draw speed against accuracy of every solver of a scene
    Chart(measure::Conduct<Chart>),
    /// Show where each method holds, bends and breaks
    Stability(stability::StabilityArgs),
    /// Measure a cable's motions, or robots of a family
    Measure(measure::MeasureArgs),
    /// The main job: tables and charts of the shipped models
    Reproduce(reproduce::ReproduceArgs),
    /// Check which results still hold, make them again, write their figures into the documents
    Results(results::ResultsArgs),
    /// Write one page with all tables, charts, maps and replays
    Report(report::ReportArgs),
    /// Train, evaluate or show a policy
    Policy(policy::PolicyArgs),
    /// Fit parameters of robot, contact and scene to measured trajectories, and judge the fit on others
    Calibrate(measure::Conduct<Calibration>),
    /// Read every URDF and MJCF of a folder and roll it out, or name what is not supported
    Urdf(urdf::UrdfArgs),
    /// Serve a page on this machine: a robot that steps in real time, to be pushed and given another solver
    Live(live::LiveArgs),
    /// Change files of every kind at random and read them: each is refused or used, without a panic
    Campaign(campaign::CampaignArgs),
    /// List robots, scenes, tasks, models, rows
    List(list::ListArgs),
    /// Format, clippy, circles of imports, docs, tests
    Check,
}

fn program() -> Command {
    commands::prepare(Verb::command())
}

fn parse(words: impl IntoIterator<Item = OsString>) -> Result<Verb, clap::Error> {
    let mut program = program();
    let words: Vec<OsString> = words.into_iter().collect();
    // Results, checkpoints and pages name files as text.
    if let Some(word) = words.iter().skip(1).find(|word| word.to_str().is_none()) {
        let said = format!("`{}` is not UTF-8; rename the file or folder, or make a link to it with such a name", word.display());
        return Err(program.error(ErrorKind::InvalidUtf8, said));
    }
    let matches = program.try_get_matches_from_mut(words)?;
    if matches.get_flag("json") {
        out::json();
    }
    Verb::from_arg_matches(&matches).map_err(|e| e.format(&mut program))
}

fn run(verb: Verb) -> Result<()> {
    match verb {
        Verb::Dataset(args) => dataset::run(args),
        Verb::Inspect(args) => inspect::run(args),
        Verb::Train(args) => train::run(*args),
        Verb::Rollout(args) => rollout::run(args),
        Verb::Evaluate(args) => evaluate::run(args),
        Verb::Chart(args) => args.run(),
        Verb::Stability(args) => stability::run(args),
        Verb::Measure(args) => measure::run(args),
        Verb::Reproduce(args) => reproduce::run(args),
        Verb::Results(args) => results::run(args, commands::reference(program())),
        Verb::Report(args) => report::run(args),
        Verb::Policy(args) => policy::run(args),
        Verb::Calibrate(args) => args.run(),
        Verb::Urdf(args) => urdf::run(args),
        Verb::Live(args) => live::run(args),
        Verb::Campaign(args) => campaign::run(args),
        Verb::List(args) => list::run(args),
        Verb::Check => check::run(),
    }
}

/// Runs a verb on the threads that all work is spread over; where none can be had, on this one.
fn spread(verb: Verb) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new;
    // What is no failure of the system is a pool that is there.
    let Some(e) = pool().build_global().err().filter(|e| e.source().is_some()) else { return run(verb) };
    tell!("note: no threads can be started ({e}): all is done on one; allow more (ulimit -u), or ask for fewer (RAYON_NUM_THREADS)");
    pool().num_threads(1).use_current_thread().build()?.install(|| run(verb))
}

/// Does what a command line says, whose first word is the program; the exit code.
pub fn call(words: impl IntoIterator<Item = OsString>) -> u8 {
    signals::heed();
    Provenance::begin();
    match parse(words) {
        Ok(verb) => match spread(verb).and_then(|()| out::finish()) {
            Ok(()) => signals::ended(),
            Err(error) => {
                let code = refusals::end(&refusals::failure(&error));
                nerd_train::stop::asked().map_or(code, signals::code)
            }
        },
        // Who asks for help, or for nothing at all, sees the verbs.
        Err(error) if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => error.exit(),
        Err(error) => refusals::end(&refusals::usage(&error)),
    }
}
