//! The corpus: a small case for each fault found so far, with its expected outcome.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::judge::{Case, Outcome, judge};
use nerd_lab::campaign::repeated;

use super::{case::Kind, files::Files};

/// Text for TRAIN in a command line.
const TRAIN: &str = "train --robot pendulum --recipe small --embedding 8 --layers 1 --history 4 --transitions 200 --frames 20 --updates 2 \
                     --batch 4 --rollouts 1";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// `accepted`, or words of the refusal.
    expect: String,
    /// Command lines, in place of the kind's first one.
    line: Option<String>,
    /// The file, in place of the kind's first one.
    file: Option<String>,
    /// Text of the file to replace; by default the whole file.
    from: Option<String>,
    /// The replacement; without it the file is removed.
    to: Option<String>,
}

/// Entries of each kind, by name.
pub fn entries() -> BTreeMap<Kind, BTreeMap<String, Entry>> {
    toml::from_str(include_str!("assets/corpus.toml")).expect("corpus.toml")
}

impl Entry {
    fn case(&self, kind: Kind, good: &Files) -> Case {
        let first = ["f/robot.urdf", "f/robot.toml", "f/pendulum.csv", "f/paper/config.json", "", "f/brick.gltf"]
            [kind as usize];
        let (name, mut files) = (self.file.as_deref().unwrap_or(first), good.clone());
        if kind == Kind::Urdf {
            files.remove("f/robot.toml");
            files.insert("f/robot.urdf".into(), include_bytes!("assets/corpus.urdf").into());
        }
        match (&self.from, self.to.as_deref().map(repeated)) {
            (None, Some(to)) => drop(files.insert(name.into(), to.into())),
            (Some(from), Some(to)) => {
                let text = String::from_utf8_lossy(files.get(name).map_or(&[], Vec::as_slice)).into_owned();
                assert!(text.contains(from), "corpus.toml: no `{from}` in {name}");
                files.insert(name.into(), text.replacen(from, &to, 1).into());
            }
            (_, None) => drop(files.remove(name)),
        }
        let mut before: Vec<String> = match (&self.line, kind) {
            (Some(lines), _) => lines.lines().map(|line| line.replace("TRAIN", TRAIN)).collect(),
            (None, Kind::Csv) => {
                vec!["rollout --robot pendulum --scene plane --states f/pendulum.csv --out out/r.csv".into()]
            }
            (None, Kind::Model) => vec!["stamp f/paper".into(), kind.lines()[1].into()],
            (None, kind) => vec![kind.lines()[0].replace("ROBOT", "robot")],
        };
        let line = before.pop().unwrap_or_default();
        Case { files, before, line }
    }

    /// The outcome, if it is not the expected one.
    pub fn wrong(&self, kind: Kind, good: &Files) -> Option<String> {
        let outcome = judge(&self.case(kind, good));
        let right = match &outcome {
            Outcome::Accepted => self.expect == "accepted",
            Outcome::Refused(words) => self.expect != "accepted" && words.contains(&self.expect),
            Outcome::Fault(..) => false,
        };
        (!right).then(|| format!("{outcome:?}, expected `{}`", self.expect))
    }
}
