//! `cargo xtask policy train|evaluate|show`: policies learned on any solver, played on any other.

use anyhow::Result;

pub mod arena;
mod card;
mod clock;
mod curve;
pub mod evaluate;
pub mod reproduce;
mod show;
mod train;

/// Train, evaluate or show a policy.
#[derive(clap::Args, Clone, Debug)]
pub struct PolicyArgs {
    #[command(subcommand)]
    pub verb: PolicyVerb,
}

/// What to do with it.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum PolicyVerb {
    /// Train a policy by PPO, or go on training
    Train(Box<train::TrainArgs>),
    /// Play a policy in the truth and in the learned simulator
    Evaluate(evaluate::EvaluateArgs),
    /// Write one episode as a page that any browser plays
    Show(show::ShowArgs),
}

/// Runs the verb.
pub fn run(args: PolicyArgs) -> Result<()> {
    match args.verb {
        PolicyVerb::Train(args) => train::run(*args),
        PolicyVerb::Evaluate(args) => evaluate::run(args),
        PolicyVerb::Show(args) => show::run(args),
    }
}
