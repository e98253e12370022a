//! Verbs that measure: an experiment's settings as options, its tables on standard output, its result in a folder.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use nerd_lab::experiments::Experiment;
use nerd_train::settings::Settings;
use nerd_train::shipped::results;

use crate::keys::Keys;
use crate::out::{conduct, tables};

/// An experiment.
#[derive(clap::Args, Clone, Debug)]
pub struct ConductArgs<T: Settings + Clone + std::fmt::Debug + Send + Sync + 'static> {
    #[command(flatten)]
    pub keys: Keys<T>,
    /// Folder to write [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

impl<T: Settings + Experiment + Clone + std::fmt::Debug + Send + Sync> ConductArgs<T> {
    /// Its settings.
    pub fn settings(&self) -> Result<T> {
        T::default().with(&self.keys.given).map_err(|e| anyhow!(e))
    }

    /// Measures it into the folder.
    pub fn run(self) -> Result<()> {
        conduct(&self.settings()?, &self.out.unwrap_or_else(results))
    }

    /// Measures it; writes only where a folder is named.
    pub fn try_out(self) -> Result<()> {
        if self.out.is_some() {
            return self.run();
        }
        tables(&self.settings()?.measure()?.tables);
        Ok(())
    }
}
