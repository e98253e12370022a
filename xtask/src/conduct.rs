//! Verbs that measure: an experiment's settings as options, its tables on standard output, its result in a folder.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use nerd_train::experiments::Experiment;
use nerd_train::report::Table;
use nerd_train::settings::Settings;
use nerd_train::shipped::results;

use crate::keys::Keys;

/// An experiment.
#[derive(clap::Args, Clone, Debug)]
pub struct ConductArgs<T: Settings + Clone + std::fmt::Debug + Send + Sync + 'static> {
    #[command(flatten)]
    pub keys: Keys<T>,
    /// Folder to write [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Tables as JSON
    #[arg(long)]
    pub json: bool,
}

impl<T: Settings + Experiment + Clone + std::fmt::Debug + Send + Sync> ConductArgs<T> {
    /// Its settings.
    pub fn settings(&self) -> Result<T> {
        T::default().with(&self.keys.given).map_err(|e| anyhow!(e))
    }

    /// Measures it into the folder.
    pub fn run(self) -> Result<()> {
        conduct(&self.settings()?, &self.out.unwrap_or_else(results), self.json)
    }

    /// Measures it; writes only where a folder is named.
    pub fn try_out(self) -> Result<()> {
        if self.out.is_some() {
            return self.run();
        }
        let settings = self.settings()?;
        show(&settings.tables(&settings.measure()?)?, self.json)
    }
}

/// Measures an experiment, writes it into a folder and prints its tables.
pub fn conduct<E: Experiment>(experiment: &E, out: &Path, json: bool) -> Result<()> {
    show(&nerd_train::experiments::conduct(experiment, out)?.tables, json)?;
    eprintln!("written to {}", out.display());
    Ok(())
}

/// Tables on standard output, for people or as one JSON object with a list for each.
pub fn show(tables: &[Table], json: bool) -> Result<()> {
    if json {
        let all: serde_json::Map<_, _> = tables.iter().map(|table| (table.name.clone(), table.json())).collect();
        println!("{}", serde_json::to_string_pretty(&all).context("tables as JSON")?);
    } else {
        tables.iter().for_each(|table| println!("{}", table.markdown()));
    }
    Ok(())
}
