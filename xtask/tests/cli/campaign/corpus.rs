//! The corpus: a small case for each fault that was found once, with what must become of it.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::judge::{Case, Outcome, judge};
use nerd_lab::campaign::repeated;

use super::{case::Kind, files::Files};

/// TRAIN of a line.
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
    /// What is replaced in it, or all of it.
    from: Option<String>,
    /// By what; without it the file goes.
    to: Option<String>,
}

/// Of each kind, by name.
pub fn entries() -> BTreeMap<Kind, BTreeMap<String, Entry>> {
    toml::from_str(include_str!("assets/corpus.toml")).expect("corpus.toml")
}

impl Entry {
    fn case(&self, kind: Kind, good: &Files) -> Case {
        let first = ["f/robot.urdf", "f/robot.toml", "f/pendulum.csv", "f/paper/config.json", "", "f/brick.gltf"][kind as usize];
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
            (None, Kind::Csv) => vec!["rollout --robot pendulum --scene plane --states f/pendulum.csv --out out/r.csv".into()],
            (None, Kind::Model) => vec!["stamp f/paper".into(), kind.lines()[1].into()],
            (None, kind) => vec![kind.lines()[0].replace("ROBOT", "robot")],
        };
        let line = before.pop().unwrap_or_default();
        Case { files, before, line }
    }

    /// What is wrong with how it ends.
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
