//! Experiments of the laboratory as verbs, whose options are their settings; `cargo xtask measure` has two.

use nerd_lab::experiments::{Experiment, family::Family, motions::Motions};
use nerd_train::settings::Settings;

use crate::out::{conduct, tables};
use crate::prelude::*;

#[derive(clap::Args, Clone, Debug)]
pub struct Conduct<T: Settings + Clone + std::fmt::Debug + Send + Sync + 'static> {
    #[command(flatten)]
    pub keys: Keys<T>,
    /// Folder to write [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

impl<T: Settings + Experiment + Clone + std::fmt::Debug + Send + Sync> Conduct<T> {
    /// Measures it into the folder, and shows its tables.
    pub fn run(self) -> Result<()> {
        conduct(&self.keys.settings()?, &self.out.unwrap_or_else(results)).map(drop)
    }

    /// Measures it; writes only where a folder is named.
    pub fn try_out(self) -> Result<()> {
        if self.out.is_some() {
            return self.run();
        }
        tables(&self.keys.settings()?.measure()?.tables);
        Ok(())
    }
}

#[derive(clap::Args, Clone, Debug)]
pub struct MeasureArgs {
    #[command(subcommand)]
    pub what: What,
}

#[derive(clap::Subcommand, Clone, Debug)]
pub enum What {
    /// Errors of solvers along motions of a data set's kind that none has seen
    Motions(Conduct<Motions>),
    /// Robots of a family beside models that are told or guess them, by the frames seen
    Family(Conduct<Family>),
}

pub fn run(args: MeasureArgs) -> Result<()> {
    match args.what {
        What::Motions(args) => args.run(),
        What::Family(args) => args.run(),
    }
}
