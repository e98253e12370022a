//! The corpus: a small case for each fault that was found once, with what must become of it.

use serde::Deserialize;

use super::judge::{Case, Outcome};
use super::{case::Kind, files::Files, text::repeated};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    kind: Kind,
    name: String,
    /// `accepted`, or words of the refusal.
    expect: String,
    /// Command lines, in place of the kind's first one.
    line: Option<String>,
    /// The file, in place of the kind's first one.
    file: Option<String>,
    /// What is replaced in it, or all of it.
    from: Option<String>,
    /// By what; without it the file goes.
    to: Option<String>,
}

pub fn entries() -> Vec<Entry> {
    #[derive(Deserialize)]
    struct Corpus {
        case: Vec<Entry>,
    }
    let corpus: Corpus = toml::from_str(include_str!("assets/corpus.toml")).expect("corpus.toml");
    corpus.case
}

impl Entry {
    pub fn case(&self, good: &Files) -> Case {
        let first = ["f/robot.urdf", "f/robot.toml", "f/pendulum.csv", "f/paper/config.json", "", "f/brick.gltf"][self.kind as usize];
        let (name, mut files) = (self.file.as_deref().unwrap_or(first), good.clone());
        if self.kind == Kind::Urdf {
            files.remove("f/robot.toml");
        }
        match (&self.from, self.to.as_deref().map(repeated)) {
            (None, Some(to)) => drop(files.insert(name.into(), to.into())),
            (Some(from), Some(to)) => {
                let text = String::from_utf8_lossy(files.get(name).map_or(&[], Vec::as_slice)).into_owned();
                assert!(text.contains(from), "corpus.toml, {}: no `{from}` in {name}", self.name);
                files.insert(name.into(), text.replacen(from, &to, 1).into());
            }
            (_, None) => drop(files.remove(name)),
        }
        let mut before: Vec<String> = match (&self.line, self.kind) {
            (Some(lines), _) => lines.lines().map(String::from).collect(),
            (None, Kind::Csv) => vec!["rollout --robot pendulum --scene plane --states f/pendulum.csv --out out/r.csv".into()],
            (None, Kind::Model) => vec!["stamp f/paper".into(), self.kind.lines()[1].into()],
            (None, kind) => vec![kind.lines()[0].replace("ROBOT", "robot")],
        };
        let line = before.pop().unwrap_or_default();
        Case { files, before, line }
    }

    pub fn wrong(&self, outcome: &Outcome) -> Option<String> {
        let right = match outcome {
            Outcome::Accepted => self.expect == "accepted",
            Outcome::Refused(words) => self.expect != "accepted" && words.contains(&self.expect),
            Outcome::Fault(..) => false,
        };
        (!right).then(|| format!("{} {}: {outcome:?}, expected `{}`", self.kind.name(), self.name, self.expect))
    }
}
