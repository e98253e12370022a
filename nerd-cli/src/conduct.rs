//! Makes verbs of experiments, with the settings as options.

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
