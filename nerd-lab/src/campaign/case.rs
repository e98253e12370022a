//! Cases by number: good files of one kind, one of them changed, and a command line that uses them. The same seed and number make the
//! same bytes, so a case that killed its process is made again to be shown.

use mutatis::Session;
use nerd_sim::prelude::System;
use serde::Deserialize;

use super::files::Files;
use super::judge::Case;
use super::text::{Dictionary, dice};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Urdf,
    Toml,
    Csv,
    Model,
    Line,
}

const LINES: &str = include_str!("../../assets/campaign/lines.txt");

/// Robots, the small ones more often: a case of theirs takes less time.
const ROBOTS: &str = "cartpole cartpole pendulum pendulum pendulum cube cube franka ant anymal pendulum-paper cube-paper";

impl Kind {
    pub const ALL: [Self; 5] = [Self::Urdf, Self::Toml, Self::Csv, Self::Model, Self::Line];

    /// The kind of a case: of twenty in a row six, six, four, three and one, since a command line takes long.
    pub fn of(number: u64) -> Self {
        Self::ALL[[6, 12, 16, 19, 20].iter().position(|end| number % 20 < *end).unwrap_or(0)]
    }

    pub fn name(self) -> &'static str {
        ["urdf", "toml", "csv", "model", "line"][self as usize]
    }

    fn words(self) -> Dictionary {
        match self {
            Self::Urdf => Dictionary::new(include_str!("../../assets/campaign/urdf.txt"), false),
            Self::Toml => Dictionary::new(include_str!("../../assets/campaign/toml.txt"), false),
            Self::Csv => Dictionary::new(include_str!("../../assets/campaign/csv.txt"), false),
            Self::Model => Dictionary::new(include_str!("../../assets/campaign/model.txt"), false),
            Self::Line => Dictionary::new(include_str!("../../assets/campaign/line.txt"), true),
        }
    }

    pub fn lines(self) -> Vec<&'static str> {
        LINES.lines().filter_map(|line| line.strip_prefix(self.name())?.strip_prefix(' ')).collect()
    }

    pub fn make(self, seed: u64, number: u64, good: &Files) -> Case {
        let mut session = Session::new().seed(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ number);
        let (session, words) = (&mut session, &self.words());
        let (lines, robots): (Vec<_>, Vec<_>) = (self.lines(), ROBOTS.split(' ').collect());
        let mut case = Case { files: good.clone(), line: lines[dice(session, lines.len())].into(), before: Vec::new() };
        match self {
            Self::Urdf | Self::Toml => {
                let robot = robots[dice(session, robots.len())];
                let (spec, xml) = System::texts(robot).unwrap_or_default();
                let mut texts = [xml.as_bytes().to_vec(), spec.as_bytes().to_vec()];
                words.change(session, &mut texts[usize::from(self == Self::Toml)]);
                let [xml, spec] = texts;
                case.line = case.line.replace("ROBOT", robot);
                case.files.insert(format!("f/{robot}.urdf"), xml);
                case.files.extend((self == Self::Toml).then(|| (format!("f/{robot}.toml"), spec)));
            }
            Self::Csv => {
                let table = case.value("--states").unwrap_or_default().to_string();
                case.files.entry(table).and_modify(|text| words.change(session, text));
            }
            Self::Model => {
                let name = ["config.json", "config.json", "normalizer.json", "model.safetensors", "model.safetensors"][dice(session, 5)];
                let name = format!("{}/{name}", case.value("--model").unwrap_or_default());
                case.before = vec![format!("stamp {}", case.value("--model").unwrap_or_default())];
                match dice(session, 32) {
                    0 => drop(case.files.remove(&name)),
                    _ if name.ends_with("json") => drop(case.files.entry(name).and_modify(|text| words.change(session, text))),
                    _ => drop(case.files.entry(name).and_modify(|bytes| tensors(session, bytes))),
                }
            }
            // An option a line, until it is whole again.
            Self::Line => {
                let mut text = case.line.replace(" --", "\n--").into_bytes();
                words.change(session, &mut text);
                case.line = String::from_utf8_lossy(&text).replace('\n', " ");
            }
        }
        case
    }
}

/// A weight, or any byte of a safetensors file.
fn tensors(session: &mut Session, file: &mut Vec<u8>) {
    let data = file.first_chunk().map_or(0, |length| u64::from_le_bytes(*length) as usize) + 8;
    let at = data + dice(session, (file.len() - data) / 4) * 4;
    match file[at..].first_chunk_mut().filter(|_| dice(session, 2) == 0) {
        Some(bytes) => {
            let mut weight = f32::from_le_bytes(*bytes);
            session.mutate(&mut weight).unwrap_or_default();
            *bytes = weight.to_le_bytes();
        }
        None => session.mutate(file).unwrap_or_default(),
    }
}
