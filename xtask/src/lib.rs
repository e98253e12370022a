//! `cargo xtask VERB`: the verbs of [`nerd_cli`], and those of developers, with one file each.

use std::ffi::OsString;

use anyhow::Result;
use clap::Parser;
use nerd_cli::call::{Program, program};
use nerd_lab::{campaign::Campaign, experiments::chart::Chart};

#[macro_use(say)]
extern crate nerd_cli;
#[macro_use(tell)]
extern crate nerd_train;

mod check;
mod fuzz;
mod list;
mod measure;
mod prelude;
mod reference;
mod report;
mod reproduce;
mod results;
mod stability;

/// NeRD in Rust: data, training, rollouts, measurement.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version)]
enum Verb {
    #[command(flatten)]
    User(nerd_cli::verbs::Verb),
    /// Draw speed against accuracy of every solver in a scene
    Chart(nerd_cli::conduct::Conduct<Chart>),
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
    /// Fuzz the readers of files: each changed file must be accepted or refused without a panic
    Fuzz(nerd_cli::options::Keys<Campaign>),
    /// List robots, scenes, tasks, models or rows of the stability suite
    #[command(subcommand)]
    List(list::What),
    /// Check format, import cycles, lints, documentation, examples and tests
    Check,
}

impl Program for Verb {
    fn run(self) -> Result<()> {
        match self {
            Self::User(verb) => verb.run(),
            Self::Chart(args) => args.run(),
            Self::Stability(args) => stability::run(args),
            Self::Measure(args) => measure::run(args),
            Self::Reproduce(args) => reproduce::run(args),
            Self::Results(args) => results::run(args, reference::reference(program::<Self>())),
            Self::Report(args) => report::run(args),
            Self::Fuzz(args) => fuzz::run(args),
            Self::List(args) => list::run(args),
            Self::Check => check::run(),
        }
    }
}

/// Runs a command line (its first word is the program); returns the exit code.
pub fn call(words: impl IntoIterator<Item = OsString>) -> u8 {
    nerd_cli::call::call::<Verb>(words)
}
