//! The corpus: one small file for each fault that was found once, tried again. `cargo xtask campaign --replay xtask/tests/corpus`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result};
use serde_json::Value;

use super::bench::Bench;
use super::case::{Files, Kind, Verdict};
use super::child::{End, SECONDS, SLACK, limit_memory, wait};
use super::files::below;
use super::worker::{caught, quiet};

/// Tries every file below the paths: `KIND/NAME: ..`, a line to stdout each. One that takes its process with it is a fault.
pub fn replay(paths: &[PathBuf]) -> Result<()> {
    if let [file] = paths
        && file.is_file()
    {
        return one(file);
    }
    let said = tempfile::NamedTempFile::new()?;
    for path in paths {
        let files = if path.is_dir() { below(path)? } else { vec![path.clone()] };
        for file in files.iter().filter(|f| kind(f).is_some()) {
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["campaign", "--replay"]).arg(file).env("RUST_BACKTRACE", "0").stdout(said.reopen()?).stderr(Stdio::null());
            said.as_file().set_len(0)?;
            let end = wait(command.spawn()?, SECONDS + SLACK)?;
            match (end, std::fs::read_to_string(said.path())?) {
                (End::Code(0), words) => print!("{words}"),
                (end, _) => println!("{}: FAULT {end:?}", name(file)),
            }
        }
    }
    Ok(())
}

fn one(file: &Path) -> Result<()> {
    limit_memory()?;
    quiet();
    let bench = Bench::new()?;
    let (kind, case) = read(file, &bench).with_context(|| file.display().to_string())?;
    println!("{}: {}", name(file), words(&caught(kind, &case, &bench)?));
    Ok(())
}

/// Folder and file.
fn name(file: &Path) -> String {
    let of = |path: Option<&Path>| path.and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    format!("{}/{}", of(file.parent()), of(Some(file)))
}

/// A file's kind is its folder's name, its ending that of the kind.
fn kind(path: &Path) -> Option<Kind> {
    let folder = path.parent()?.file_name()?.to_str()?;
    let ending = match folder {
        "model" => "json",
        "line" => "txt",
        name => name,
    };
    Kind::ALL.into_iter().find(|k| k.name() == folder && path.extension().is_some_and(|e| e == ending))
}

fn words(verdict: &Verdict) -> String {
    match verdict {
        Verdict::Accepted => "accepted".into(),
        Verdict::Refused(words) => format!("refused: {}", words.replace('\n', " ")),
        Verdict::Fault(fault, words) => format!("FAULT {}: {words}", fault.name()),
    }
}

/// The case of a file; what it needs beside it is good.
fn read(path: &Path, bench: &Bench) -> Result<(Kind, Files)> {
    let kind = kind(path).context("no urdf/*.urdf, toml/*.toml, csv/*.csv, model/*.json or line/*.txt")?;
    let bytes = expanded(std::fs::read(path)?);
    let alone = |name: &str| Files::from([(name.to_string(), bytes.clone())]);
    let files = match kind {
        Kind::Urdf => alone("robot.urdf"),
        Kind::Toml => {
            let mut files = alone("robot.toml");
            files.insert("robot.urdf".into(), std::fs::read(path.with_file_name("robot.urdf"))?);
            files
        }
        Kind::Csv => alone("pendulum.csv"),
        Kind::Model => spoilt(bench, serde_json::from_slice(&bytes)?)?,
        Kind::Line => alone("line.txt"),
    };
    Ok((kind, files))
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
/// and of a safetensors file the first number of a tensor is set.
fn spoilt(bench: &Bench, patch: Value) -> Result<Files> {
    let mut files = bench.models[0].clone();
    for (name, change) in patch.as_object().context("a patch is an object of files")? {
        match (name.as_str(), change) {
            (_, Value::Null) => drop(files.remove(name)),
            ("model.safetensors", Value::Object(tensors)) => {
                for (tensor, number) in tensors {
                    let file = files.get_mut(name).context("no such file")?;
                    set(file, tensor, number.as_str().context("numbers of tensors stand in quotes")?.parse()?)?;
                }
            }
            _ => {
                let file = files.get_mut(name).with_context(|| format!("no file `{name}`"))?;
                let mut tree: Value = serde_json::from_slice(file)?;
                merge(&mut tree, change);
                *file = tree.to_string().into_bytes();
            }
        }
    }
    Ok(files)
}

/// A merge patch (RFC 7396).
fn merge(tree: &mut Value, patch: &Value) {
    let Value::Object(changes) = patch else {
        *tree = patch.clone();
        return;
    };
    if !tree.is_object() {
        *tree = Value::Object(Default::default());
    }
    let Some(map) = tree.as_object_mut() else { return };
    for (key, change) in changes {
        match change {
            Value::Null => drop(map.remove(key)),
            _ => merge(map.entry(key.clone()).or_insert(Value::Null), change),
        }
    }
}

fn set(file: &mut [u8], tensor: &str, number: f32) -> Result<()> {
    let length = file.first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b) as usize);
    let header: Value = serde_json::from_slice(&file[8..8 + length])?;
    let at = header[tensor]["data_offsets"][0].as_u64().with_context(|| format!("no tensor `{tensor}`"))? as usize + 8 + length;
    file[at..at + 4].copy_from_slice(&number.to_le_bytes());
    Ok(())
}
