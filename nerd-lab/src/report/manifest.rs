//! `results/manifest.toml`: every result with the command that makes it, and whether it still holds.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::artifact::Head;
use crate::error::Result;

/// All results that the repository keeps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Each of them.
    pub artefact: Vec<Entry>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// `results/NAME.json`.
    pub name: String,
    /// What it shows, in one line.
    pub about: String,
    /// What makes it, behind `cargo xtask`.
    pub command: String,
    /// Kept as it was measured: making it again takes days of a GPU, and the models it trained were not kept. It is never stale.
    #[serde(default)]
    pub record: bool,
}

/// How a result stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Status {
    /// It was measured by its command on what is here now.
    Current,
    /// It is kept as it was measured, at this commit.
    Record(String),
    /// There is none.
    Missing,
    /// Where it comes from cannot be told: this is absent, or wrong.
    Untraceable(String),
    /// Files of the checkout had been changed when it was measured.
    Dirty,
    /// It was measured by another command.
    Command(String),
    /// These have changed since.
    Stale(Vec<String>),
}

impl Status {
    /// Whether nothing is to be done.
    pub fn holds(&self) -> bool {
        matches!(self, Self::Current | Self::Record(_))
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Current => f.write_str("current"),
            Self::Record(commit) => write!(f, "record of {commit}"),
            Self::Missing => f.write_str("missing"),
            Self::Untraceable(what) => write!(f, "untraceable: {what}"),
            Self::Dirty => f.write_str("dirty"),
            Self::Command(found) => write!(f, "made by `{found}`"),
            Self::Stale(what) => write!(f, "stale: {}", what.join(", ")),
        }
    }
}

impl Manifest {
    /// That of a folder of results.
    ///
    /// # Errors
    /// If it cannot be read, or a name stands in it twice.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("manifest.toml");
        let text = nerd_sim::files::read_text(&path).map_err(crate::error::file(&path))?;
        let manifest: Self = toml::from_str(&text).map_err(|e| crate::error::format(&path)(e.to_string().replace('\n', " ")))?;
        let twice = manifest.artefact.iter().enumerate().find(|(i, e)| manifest.artefact[..*i].iter().any(|other| other.name == e.name));
        match twice {
            Some((_, entry)) => Err(crate::error::format(&path)(format!("`{}` stands in it twice", entry.name))),
            None => Ok(manifest),
        }
    }

    /// Results in the folder that it does not list.
    pub fn strangers(&self, folder: &Path) -> Vec<String> {
        let names = std::fs::read_dir(folder).into_iter().flatten().flatten().filter_map(|file| {
            let path = file.path();
            let json = path.extension().is_some_and(|e| e == "json");
            json.then(|| path.file_stem().map(|stem| stem.to_string_lossy().into_owned())).flatten()
        });
        let mut strangers: Vec<String> = names.filter(|name| self.artefact.iter().all(|entry| entry.name != *name)).collect();
        strangers.sort();
        strangers
    }
}

impl Entry {
    /// How the result stands in a folder.
    pub fn status(&self, folder: &Path) -> Status {
        if !folder.join(format!("{}.json", self.name)).exists() {
            return Status::Missing;
        }
        let head = match Head::read(folder, &self.name) {
            Ok(head) => head,
            Err(e) => return Status::Untraceable(e.to_string()),
        };
        let from = &head.provenance;
        if !from.traceable() {
            return Status::Untraceable("it has no commit or command".into());
        }
        if from.dirty() {
            return Status::Dirty;
        }
        if self.record {
            return Status::Record(from.commit.clone());
        }
        if head.inputs.0.is_empty() {
            return Status::Untraceable("it has no hash of what it was measured on".into());
        }
        let command = plain(&from.command);
        if command != plain(&self.command) {
            return Status::Command(command);
        }
        let changed = head.inputs.changed();
        if changed.is_empty() { Status::Current } else { Status::Stale(changed) }
    }
}

/// A command line without what does not change a result: how it is called and where it writes.
fn plain(command: &str) -> String {
    let mut words = command.strip_prefix("cargo xtask ").unwrap_or(command).split_whitespace();
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        match word {
            "--out" => drop(words.next()),
            "--json" => {}
            _ => kept.push(word),
        }
    }
    kept.join(" ")
}
