//! Cases by number: good files of one kind with one file changed, and a command line that uses them. The same seed and
//! number make the same bytes, so a case that killed its process can be made again.

use nerd_sim::prelude::System;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng as Dice;
use serde::Deserialize;

use super::{files::Files, judge::Case};
use nerd_lab::campaign::{Dictionary, byte};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Urdf,
    Toml,
    Csv,
    Model,
    Line,
    Mesh,
}

const LINES: &str = include_str!("assets/lines.txt");

/// Robots of cases; small robots come more often, since their cases run faster.
const ROBOTS: &str =
    "cartpole cartpole pendulum pendulum pendulum cube cube franka ant anymal pendulum-paper cube-paper";

/// A robot of one mesh, and that mesh in each format that is read.
const BRICK: &str = include_str!("assets/brick.urdf");
const MESHES: [(&str, &[u8]); 6] = [
    ("gltf", include_bytes!("assets/brick.gltf")),
    ("glb", include_bytes!("assets/brick.glb")),
    ("ply", include_bytes!("assets/brick.ply")),
    ("ply", include_bytes!("assets/binary.ply")),
    ("dae", include_bytes!("assets/brick.dae")),
    ("obj", include_bytes!("assets/brick.obj")),
];

impl Kind {
    pub const ALL: [Self; 6] = [Self::Urdf, Self::Toml, Self::Csv, Self::Model, Self::Line, Self::Mesh];

    /// The kind of a case. Twenty in a row have 5, 4, 3, 2, 1 and 5 of the kinds; command lines take longest.
    pub fn of(number: u64) -> Self {
        Self::ALL[[5, 9, 12, 14, 15, 20].iter().position(|end| number % 20 < *end).unwrap_or(0)]
    }

    pub fn name(self) -> &'static str {
        ["urdf", "toml", "csv", "model", "line", "mesh"][self as usize]
    }

    fn words(self) -> Dictionary {
        match self {
            Self::Urdf => Dictionary::urdf(),
            Self::Toml => Dictionary::toml(),
            Self::Csv => Dictionary::csv(),
            Self::Model => Dictionary::model(),
            Self::Line => Dictionary::new(include_str!("assets/line.txt"), true),
            Self::Mesh => Dictionary::new(include_str!("assets/mesh.txt"), false),
        }
    }

    pub fn lines(self) -> Vec<&'static str> {
        LINES.lines().filter_map(|line| line.strip_prefix(self.name())?.strip_prefix(' ')).collect()
    }

    pub fn make(self, seed: u64, number: u64, good: &Files) -> Case {
        let (dice, words) = (&mut Dice::seed_from_u64(seed), &self.words());
        dice.set_stream(number);
        let (lines, robots): (Vec<_>, Vec<_>) = (self.lines(), ROBOTS.split(' ').collect());
        let mut case =
            Case { files: good.clone(), line: lines[dice.random_range(0..lines.len())].into(), before: Vec::new() };
        match self {
            Self::Urdf | Self::Toml => {
                let robot = robots[dice.random_range(0..robots.len())];
                let (spec, xml) = System::texts(robot).unwrap_or_default();
                let mut texts = [xml.as_bytes().to_vec(), spec.as_bytes().to_vec()];
                words.change(dice, &mut texts[usize::from(self == Self::Toml)]);
                let [xml, spec] = texts;
                case.line = case.line.replace("ROBOT", robot);
                case.files.insert(format!("f/{robot}.urdf"), xml);
                case.files.extend((self == Self::Toml).then(|| (format!("f/{robot}.toml"), spec)));
            }
            Self::Csv => {
                let table = case.value("--states").unwrap_or_default().to_string();
                case.files.entry(table).and_modify(|text| words.change(dice, text));
            }
            Self::Model => {
                let (folder, names) = match case.value("--policy") {
                    Some(folder) => (folder.to_string(), ["config.json", "policy.safetensors", "policy.safetensors"]),
                    None => (
                        case.value("--model").unwrap_or_default().to_string(),
                        ["config.json", "normalizer.json", "model.safetensors"],
                    ),
                };
                let name = format!("{folder}/{}", names[[0, 0, 1, 2, 2][dice.random_range(0..5)]]);
                case.before = case.value("--model").map(|folder| format!("stamp {folder}")).into_iter().collect();
                match dice.random_range(0..32) {
                    0 => drop(case.files.remove(&name)),
                    _ if name.ends_with("json") => {
                        drop(case.files.entry(name).and_modify(|text| words.change(dice, text)))
                    }
                    _ => drop(case.files.entry(name).and_modify(|bytes| tensors(dice, bytes))),
                }
            }
            Self::Mesh => {
                let (kind, mesh) = MESHES[dice.random_range(0..MESHES.len())];
                let mut mesh = mesh.to_vec();
                words.change(dice, &mut mesh);
                case.files.insert("f/brick.urdf".into(), BRICK.replace("KIND", kind).into());
                case.files.insert(format!("f/brick.{kind}"), mesh);
            }
            // An option a line while the text is changed, then one line again.
            Self::Line => {
                let mut text = case.line.replace(" --", "\n--").into_bytes();
                words.change(dice, &mut text);
                case.line = String::from_utf8_lossy(&text).replace(['\n', '\0'], " ");
                // Without its limit a valid training goes on for an hour.
                if case.line.contains("train ") {
                    match case.value("--minutes").map(|word| (word.to_string(), word.parse::<f64>())) {
                        None => case.line += " --minutes 0.02",
                        Some((word, Ok(minutes))) if minutes.is_finite() && minutes > 0.02 => {
                            case.line = case.line.replace(&format!("--minutes {word}"), "--minutes 0.02");
                        }
                        Some(_) => {}
                    }
                }
            }
        }
        case
    }
}

/// Changes a weight, or any byte, of a safetensors file.
fn tensors(dice: &mut Dice, file: &mut Vec<u8>) {
    let data = file.first_chunk().map_or(0, |length| u64::from_le_bytes(*length) as usize) + 8;
    let at = data + dice.random_range(0..(file.len() - data) / 4) * 4;
    let (other, scaled): (u32, bool) = (dice.random(), dice.random());
    match file[at..].first_chunk_mut().filter(|_| dice.random()) {
        Some(bytes) if scaled => {
            *bytes = (f32::from_le_bytes(*bytes) * 10f32.powf(dice.random_range(-6.0..6.0))).to_le_bytes()
        }
        Some(bytes) => *bytes = other.to_le_bytes(),
        None => byte(dice, file),
    }
}
