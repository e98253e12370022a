//! The corpus: one small file for each fault that was found once, tried again.

use std::io;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::campaign::bench::Bench;
use crate::campaign::case::{Files, Kind, Verdict};
use crate::campaign::files::below;
use crate::campaign::model::{split, tree};

/// Every case below the paths.
pub fn files(paths: &[PathBuf]) -> io::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(if path.is_dir() { below(path)? } else { vec![path.clone()] });
    }
    all.retain(|file| kind(file).is_some());
    Ok(all)
}

/// What became of a file, in a line.
pub fn words(file: &Path, verdict: Verdict) -> String {
    let of = |path: Option<&Path>| path.and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    let words = match verdict {
        Verdict::Accepted => "accepted".into(),
        Verdict::Refused(words) => format!("refused: {}", words.replace('\n', " ")),
        Verdict::Fault(fault, words) => format!("FAULT {}: {words}", fault.name()),
    };
    format!("{}/{}: {words}", of(file.parent()), of(Some(file)))
}

/// A file's kind is its folder's name, its ending that of the kind.
pub fn kind(path: &Path) -> Option<Kind> {
    let folder = path.parent()?.file_name()?.to_str()?;
    let kind = Kind::ALL.into_iter().find(|k| k.name() == folder)?;
    let ending = match kind {
        Kind::Model => "json",
        Kind::Line => "txt",
        kind => kind.name(),
    };
    path.extension().is_some_and(|e| e == ending).then_some(kind)
}

/// The case of a file; what it needs beside it is good.
pub fn read(path: &Path, bench: &Bench) -> io::Result<(Kind, Files)> {
    let kind = kind(path).ok_or_else(|| wrong(path, "no urdf/*.urdf, toml/*.toml, csv/*.csv, model/*.json or line/*.txt"))?;
    let bytes = expanded(std::fs::read(path)?);
    let name = match kind {
        Kind::Model => return Ok((kind, spoilt(bench, &serde_json::from_slice(&bytes)?).ok_or_else(|| wrong(path, "no such place"))?)),
        Kind::Csv => "pendulum.csv",
        Kind::Urdf => "robot.urdf",
        Kind::Toml => "robot.toml",
        Kind::Line => "line.txt",
    };
    let mut files = Files::from([(name.into(), bytes)]);
    if kind == Kind::Toml {
        files.insert("robot.urdf".into(), std::fs::read(path.with_file_name("robot.urdf"))?);
    }
    Ok((kind, files))
}

fn wrong(path: &Path, words: &str) -> io::Error {
    io::Error::other(format!("{}: {words}", path.display()))
}

/// `@(/1 * 200000)@` stands for so many of them, so that what is found in large files stays small here.
fn expanded(bytes: Vec<u8>) -> Vec<u8> {
    let found = std::str::from_utf8(&bytes).ok().and_then(|text| {
        let (before, rest) = text.split_once("@(")?;
        let (inside, after) = rest.split_once(")@")?;
        let (what, times) = inside.rsplit_once(" * ")?;
        Some([before, &what.repeat(times.parse().ok()?), after].concat().into_bytes())
    });
    found.unwrap_or(bytes)
}

/// A good model as a patch changes it: `{"config.json": {"network": {"heads": 0}}}`; a file patched with null is not there,
/// and of a safetensors file the first number of a tensor is set, which stands in quotes.
fn spoilt(bench: &Bench, patch: &Value) -> Option<Files> {
    let mut files = bench.models[0].clone();
    for (name, change) in patch.as_object()? {
        let file = files.get_mut(name)?;
        match change {
            Value::Null => drop(files.remove(name)),
            Value::Object(tensors) if name == "model.safetensors" => {
                for (tensor, number) in tensors {
                    set(file, tensor, number.as_str()?.parse().ok()?)?;
                }
            }
            _ => {
                let mut json = tree(file)?;
                merge(&mut json, change);
                *file = json.to_string().into_bytes();
            }
        }
    }
    Some(files)
}

/// A merge patch (RFC 7396) that takes nothing away.
fn merge(tree: &mut Value, patch: &Value) {
    match (tree, patch) {
        (Value::Object(map), Value::Object(changes)) => {
            changes.iter().for_each(|(key, change)| merge(map.entry(key).or_insert(Value::Null), change));
        }
        (tree, patch) => *tree = patch.clone(),
    }
}

fn set(file: &mut [u8], tensor: &str, number: f32) -> Option<()> {
    let (header, data) = split(file)?;
    let at = data + tree(header)?[tensor]["data_offsets"][0].as_u64()? as usize;
    file[at..at + 4].copy_from_slice(&number.to_le_bytes());
    Some(())
}
