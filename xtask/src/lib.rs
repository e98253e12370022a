//! `cargo xtask VERB`: one file per verb. Bad input ends with one line and exit code 2, and leaves no file behind.

use std::error::Error;
use std::ffi::OsString;
use std::path::Path;

use anyhow::Result;
use clap::{Command, CommandFactory, FromArgMatches, Parser, error::ErrorKind};
use nerd_lab::campaign::Campaign;
use nerd_lab::experiments::{calibrated::Calibration, chart::Chart};
use nerd_train::provenance::Provenance;

#[macro_use(tell)]
extern crate nerd_train;

/// Prints a line to standard output; `println!` would panic on a closed pipe.
macro_rules! say {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}

mod check;
mod check_robots;
mod commands;
mod dataset;
mod evaluate;
mod fuzz;
mod inspect;
mod list;
mod live;
mod measure;
mod options;
mod out;
mod policy;
mod prelude;
mod refusals;
mod renamed;
mod report;
mod reproduce;
mod results;
mod rollout;
mod signals;
mod solvers;
mod stability;
mod train;

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
enum Verb {
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
    /// Draw speed against accuracy of every solver in a scene
    Chart(measure::Conduct<Chart>),
    /// Show where each method passes, degrades and fails
    Stability(stability::StabilityArgs),
    /// Measure solvers on new motions, or on robots with drawn parameters
    #[command(subcommand)]
    Measure(measure::What),
    /// Measure the main result: tables and charts of the shipped models
    Reproduce(reproduce::ReproduceArgs),
    /// Check which results still hold, remake them, and write their figures into the documents
    Results(results::ResultsArgs),
    /// Write one HTML page with all tables, charts, maps and replays
    Report(report::ReportArgs),
    /// Train, evaluate, show or export policies
    #[command(subcommand)]
    Policy(policy::PolicyVerb),
    /// Fit parameters of robot, contact and scene to measured trajectories, and test the fit on others
    Calibrate(measure::Conduct<Calibration>),
    /// Read URDF and MJCF files, roll each robot out, and report unsupported features
    CheckRobots(check_robots::CheckRobotsArgs),
    /// Serve a page with a robot in real time, to push it and to swap its solver
    Live(live::LiveArgs),
    /// Fuzz the readers of files: each changed file must be accepted or refused without a panic
    Fuzz(options::Keys<Campaign>),
    /// List robots, scenes, tasks, models or rows of the stability suite
    #[command(subcommand)]
    List(list::What),
    /// Check format, import cycles, lints, documentation, examples and tests
    Check,
}

fn program() -> Command {
    commands::prepare(Verb::command())
}

fn parse(words: Vec<OsString>) -> Result<Verb, clap::Error> {
    let mut program = program();
    // Calls the program in its help as it was typed: `nerd`, `python -m nerd`, else `cargo xtask`.
    if let Some(name) =
        words.first().and_then(|word| Path::new(word).file_stem()?.to_str()).filter(|name| name.ends_with("nerd"))
    {
        program = program.bin_name(name.to_string()).name(name.to_string());
    }
    // Refuses words that are not UTF-8: results, checkpoints and pages store file names as text.
    if let Some(word) = words.iter().skip(1).find(|word| word.to_str().is_none()) {
        let said = format!(
            "`{}` is not UTF-8; rename the file or folder, or make a link to it with such a name",
            word.display()
        );
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
        Verb::CheckRobots(args) => check_robots::run(args),
        Verb::Live(args) => live::run(args),
        Verb::Fuzz(args) => fuzz::run(args),
        Verb::List(args) => list::run(args),
        Verb::Check => check::run(),
    }
}

/// Runs a verb on the thread pool; on this thread alone if no threads can be started.
fn spread(verb: Verb) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new;
    // An error without a source means that the pool already exists.
    let Some(e) = pool().build_global().err().filter(|e| e.source().is_some()) else { return run(verb) };
    tell!(
        "note: no threads can be started ({e}): all is done on one; allow more (ulimit -u), or ask for fewer (RAYON_NUM_THREADS)"
    );
    pool().num_threads(1).use_current_thread().build()?.install(|| run(verb))
}

/// Runs a command line (its first word is the program); returns the exit code.
pub fn call(words: impl IntoIterator<Item = OsString>) -> u8 {
    signals::heed();
    Provenance::begin();
    let (words, note) = renamed::replace(words.into_iter().collect());
    // Keeps errors to one line: the note on old names follows a success, or ends the error's line.
    let end = note.as_ref().map_or_else(String::new, |note| format!("; {note}"));
    let refuse = |error: String, code: u8| refusals::end(&(error + &end), code);
    match parse(words) {
        Ok(verb) => match spread(verb).and_then(|()| out::finish()) {
            Ok(()) => {
                note.iter().for_each(|note| tell!("note: {note}"));
                signals::ended()
            }
            Err(error) => {
                let code = refuse(refusals::failure(&error), 1);
                nerd_train::stop::asked().map_or(code, signals::code)
            }
        },
        // Prints help, on request or without a verb.
        Err(error) if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            error.exit()
        }
        Err(error) => refuse(refusals::usage(&error), 2),
    }
}
