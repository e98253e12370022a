//! One result as a file: where it comes from, what it was measured on, its tables and its figures.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Inputs, Provenance, Table, write};
use crate::error::{Result, refuse};
use nerd_train::shipped::results;

/// A result. In JSON its data stand beside the other fields.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Artifact<T> {
    /// Commit, command, seed, machine, date.
    pub provenance: Provenance,
    /// What was measured.
    #[serde(default)]
    pub inputs: Inputs,
    /// Rollouts times frames, or whatever a better measurement has more of. A result gives way to none with less.
    #[serde(default)]
    pub effort: f64,
    /// As people read it.
    #[serde(default)]
    pub tables: Vec<Table>,
    /// Everything else.
    #[serde(flatten)]
    pub data: T,
}

/// What the file of any result has.
pub type Head = Artifact<serde_json::Map<String, serde_json::Value>>;

impl<T: Serialize + DeserializeOwned> Artifact<T> {
    /// Reads `FOLDER/NAME.json`.
    ///
    /// # Errors
    /// If it is not there, or not such a result.
    pub fn read(folder: &Path, name: &str) -> Result<Self> {
        let path = folder.join(format!("{name}.json"));
        let text = nerd_sim::files::read_text(&path).map_err(crate::error::file(&path))?;
        serde_json::from_str(&text).map_err(crate::error::format(&path))
    }

    /// Writes `NAME.json`, and its tables as `NAME.md`, into a folder.
    ///
    /// # Errors
    /// As [`may_write`], and what the file system says.
    pub fn write(&self, folder: &Path, name: &str) -> Result<()> {
        may_write(folder, name, &self.provenance, self.effort)?;
        let path = folder.join(format!("{name}.json"));
        let text = serde_json::to_string_pretty(self).map_err(crate::error::format(&path))?;
        if !self.tables.is_empty() {
            write(&folder.join(format!("{name}.md")), self.markdown().as_bytes())?;
        }
        write(&path, (text + "\n").as_bytes())
    }

    /// All its tables and where they come from.
    pub fn markdown(&self) -> String {
        let tables: Vec<String> = self.tables.iter().map(Table::markdown).collect();
        format!("{}\n{}\n", tables.join("\n"), self.provenance)
    }
}

/// Refuses to replace a result by a weaker one: by one with less effort behind it, or, in the project's own folder, a clean one by
/// one of a checkout whose files were changed. To be asked before anything is measured.
///
/// # Errors
/// [`Error::msg`], with what to do.
pub fn may_write(folder: &Path, name: &str, provenance: &Provenance, effort: f64) -> Result<()> {
    let Ok(there) = Head::read(folder, name) else { return Ok(()) };
    let path = folder.join(format!("{name}.json"));
    if effort < there.effort {
        refuse!(
            "{}: measured with {:.3e} rollout frames, this run has {effort:.3e}; write it elsewhere (--out out/try)",
            path.display(),
            there.effort
        );
    }
    let own = || folder.canonicalize().is_ok_and(|folder| results().canonicalize().is_ok_and(|results| results == folder));
    if provenance.dirty() && !there.provenance.dirty() && own() {
        refuse!("{}: of a clean checkout; commit your changes first, or write elsewhere (--out out/try)", path.display());
    }
    Ok(())
}
