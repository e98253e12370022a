//! Makes verbs of nerd-lab's experiments, with the settings as options; `cargo xtask measure` has two of them.

use nerd_lab::experiments::{Experiment, family::Family, motions::Motions};
use nerd_train::settings::Settings;

use crate::out::{conduct, tables};
use crate::prelude::*;

#[derive(clap::Args)]
pub struct Conduct<T: Settings> {
    #[command(flatten)]
    pub keys: Keys<T>,
    /// Folder to write the result into [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

impl<T: Settings + Experiment> Conduct<T> {
    /// Measures, writes the result into the folder of --out, and prints the tables.
    pub fn run(self) -> Result<()> {
        conduct(&self.keys.settings()?, &self.out.unwrap_or_else(results)).map(drop)
    }

    /// Measures and prints the tables; writes only if a folder is named.
    pub fn try_out(self) -> Result<()> {
        if self.out.is_some() {
            return self.run();
        }
        tables(&self.keys.settings()?.measure()?.tables);
        Ok(())
    }
}

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
