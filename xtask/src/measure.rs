//! `cargo xtask measure NAME --set KEY=VALUE`: an experiment of the laboratory ([`nerd_lab::experiments::REGISTRY`]).

use nerd_lab::experiments::{Entry, Experiment, REGISTRY};
use nerd_lab::report::Table;
use nerd_train::settings::Settings;

use crate::out::{conduct, table, tables};
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
    /// Its name; without one, all are listed with their settings
    pub name: Option<String>,
    /// A setting; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Folder to write [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

pub fn run(args: MeasureArgs) -> Result<()> {
    let Some(name) = &args.name else { return list() };
    conduct(&*Entry::named(name)?.with(&args.set)?, &args.out.unwrap_or_else(results)).map(drop)
}

/// The experiments, and what may be set.
fn list() -> Result<()> {
    for entry in REGISTRY {
        say!("{}: {}", entry.name, entry.about);
        let rows = (entry.keys)().into_iter().map(|key| vec![key.name(), key.help().to_string()]);
        table(&Table::new(entry.name, &["setting", "what it means"]).with(rows));
    }
    Ok(())
}
