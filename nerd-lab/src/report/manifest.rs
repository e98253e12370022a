//! Reads `results/manifest.toml`, which lists every result with its command. Checks whether each result still holds.

use nerd_cli::error;
use nerd_cli::report::{Artifact, file, names};

use crate::prelude::*;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    pub artefact: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    pub name: String,
    pub about: String,
    /// The command that makes the result, without `cargo xtask`.
    pub command: String,
    /// The command that made the result, if the present `command` is written differently.
    #[serde(default)]
    pub made: Option<String>,
    /// Whether the result is kept as measured and never stale. Measuring it again would take days on a GPU, or its
    /// inputs are lost.
    #[serde(default)]
    pub record: bool,
    /// Why the result is outdated; to be removed when its command has run again.
    #[serde(default)]
    pub stale: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Status {
    /// Measured by its command on the present inputs.
    Current,
    /// Kept as measured at the given commit, without checking its inputs.
    Record(String),
    /// Measured on inputs that have changed; the manifest gives the reason.
    Stale(String),
    /// Does not hold, for the given reason.
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
        let names = manifest.artefact.iter().map(|entry| entry.name.clone()).collect_vec();
        bounds::once(&path.display().to_string(), &names)?;
        Ok(manifest)
    }

    /// Results in the folder that the manifest does not list.
    pub fn strangers(&self, folder: &Path) -> Vec<String> {
        let listed = |name: &String| self.artefact.iter().any(|entry| entry.name == *name);
        names(folder).into_iter().filter(|name| file(folder, name).exists() && !listed(name)).sorted().collect()
    }
}

impl Entry {
    pub fn status(&self, folder: &Path) -> Status {
        let wrong = |reason: &str| Status::Wrong(reason.into());
        if !file(folder, &self.name).exists() {
            return wrong("missing");
        }
        let Artifact { provenance: from, inputs, .. } = match Artifact::read(folder, &self.name) {
            Ok(result) => result,
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

/// Removes the parts of a command line that do not affect a result: the program's name, `--out` and `--json`.
fn plain(command: &str) -> String {
    let called =
        ["cargo xtask ", "python -m nerd ", "nerd "].into_iter().find_map(|program| command.strip_prefix(program));
    let words = called.unwrap_or(command).split_whitespace().collect_vec();
    let kept = words.iter().zip(std::iter::once(&"").chain(&words));
    let kept = kept.filter(|&(word, before)| !["--out", "--json"].contains(word) && *before != "--out");
    kept.map(|(word, _)| word).join(" ")
}
