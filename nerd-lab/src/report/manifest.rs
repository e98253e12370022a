//! `results/manifest.toml`: every result with the command that makes it, and whether it still holds.

use super::artifact::{Artifact, file};
use crate::prelude::*;

use crate::error;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    pub artefact: Vec<Entry>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    pub name: String,
    pub about: String,
    /// What makes it, behind `cargo xtask`.
    pub command: String,
    /// What made it, where the program of that commit called it otherwise.
    #[serde(default)]
    pub made: Option<String>,
    /// Kept as it was measured: making it again takes days of a GPU, or what it measured was not kept. It is never stale.
    #[serde(default)]
    pub record: bool,
    /// Why it no longer describes the program, until its command is run again.
    #[serde(default)]
    pub stale: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Status {
    /// It was measured by its command on what is here now.
    Current,
    /// It is kept as it was measured, at this commit.
    Record(String),
    /// It was measured on what has changed since, as the manifest says.
    Stale(String),
    /// It does not hold, for this reason.
    Wrong(String),
}

impl Status {
    pub fn holds(&self) -> bool {
        !matches!(self, Self::Wrong(_))
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Current => f.write_str("current"),
            Self::Record(commit) => write!(f, "record of {commit}"),
            Self::Stale(why) => write!(f, "stale: {why}"),
            Self::Wrong(reason) => f.write_str(reason),
        }
    }
}

impl Manifest {
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("manifest.toml");
        let text = nerd_sim::files::read_text(&path).map_err(error::file(&path))?;
        let manifest: Self = toml::from_str(&text).map_err(|e| error::file(&path)(e.to_string().replace('\n', " ")))?;
        let names: Vec<String> = manifest.artefact.iter().map(|entry| entry.name.clone()).collect();
        bounds::once(&path.display().to_string(), &names)?;
        Ok(manifest)
    }

    /// Results in the folder that it does not list.
    pub fn strangers(&self, folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).filter(|name| file(folder, name).exists());
        let mut strangers: Vec<String> = names.filter(|name| self.artefact.iter().all(|entry| entry.name != *name)).collect();
        strangers.sort();
        strangers
    }
}

impl Entry {
    pub fn status(&self, folder: &Path) -> Status {
        let wrong = |reason: &str| Status::Wrong(reason.into());
        let Artifact { provenance: from, inputs, .. } = match Artifact::read(folder, &self.name) {
            Ok(result) => result,
            Err(_) if !file(folder, &self.name).exists() => return wrong("missing"),
            Err(e) => return wrong(&e.to_string()),
        };
        let command = plain(&from.command);
        if !from.traceable() {
            wrong("untraceable: it has no commit or command")
        } else if from.dirty() {
            wrong("dirty: files of the checkout had been changed when it was measured")
        } else if self.record {
            Status::Record(from.commit)
        } else if inputs.0.is_empty() {
            wrong("untraceable: it has no hash of what it was measured on")
        } else if command != plain(self.made.as_ref().unwrap_or(&self.command)) {
            wrong(&format!("made by `{command}`"))
        } else {
            let changed = inputs.changed();
            match &self.stale {
                None if changed.is_empty() => Status::Current,
                None => wrong(&format!("stale: {}", changed.join(", "))),
                Some(_) if changed.is_empty() => wrong("marked as stale, and it is current: take the mark away"),
                Some(why) => Status::Stale(why.clone()),
            }
        }
    }
}

/// A command line without what does not change a result: how it is called and where it writes.
fn plain(command: &str) -> String {
    let called = ["cargo xtask ", "python -m nerd "].into_iter().find_map(|program| command.strip_prefix(program));
    let mut words = called.unwrap_or(command).split_whitespace();
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
