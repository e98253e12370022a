//! `cargo xtask measure`: experiments of nerd-lab without a verb of their own.

use nerd_cli::conduct::Conduct;
use nerd_lab::experiments::{family::Family, motions::Motions};

use crate::prelude::*;

#[derive(clap::Subcommand)]
pub enum What {
    /// Measure errors of solvers along new motions, drawn as for a data set
    Motions(Conduct<Motions>),
    /// Measure errors on robots with drawn parameters, by the frames seen before a rollout
    Family(Conduct<Family>),
}

pub fn run(what: What) -> Result<()> {
    match what {
        What::Motions(args) => args.run(),
        What::Family(args) => args.run(),
    }
}
