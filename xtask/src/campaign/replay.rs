//! The corpus: one small file for each fault that was found once, tried again. `cargo xtask campaign --replay xtask/tests/corpus`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use super::bench::Bench;
use super::case::{Files, Kind, Verdict};
use super::child::limit_memory;
use super::files::below;
use super::worker::{caught, quiet};

/// Tries every file below the paths: `KIND/NAME`, a line to stdout each.
pub fn replay(paths: &[PathBuf]) -> Result<()> {
    limit_memory()?;
    quiet();
    let bench = Bench::new()?;
    for path in paths {
        let files = if path.is_dir() { below(path)? } else { vec![path.clone()] };
        for file in files {
            let Some((kind, case)) = read(&file, &bench).with_context(|| file.display().to_string())? else { continue };
            let (name, verdict) = (file.file_name().unwrap_or_default().to_string_lossy(), caught(kind, &case, &bench)?);
            println!("{}/{name}: {}", kind.name(), words(&verdict));
        }
    }
    Ok(())
}

fn words(verdict: &Verdict) -> String {
    match verdict {
        Verdict::Accepted => "accepted".into(),
        Verdict::Refused(words) => format!("refused: {}", words.replace('\n', " ")),
        Verdict::Fault(fault, words) => format!("FAULT {}: {words}", fault.name()),
    }
}

/// A file's kind is its folder's name; what it needs beside it is good. None for the good files themselves.
fn read(path: &Path, bench: &Bench) -> Result<Option<(Kind, Files)>> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let Some(kind) = Kind::ALL.into_iter().find(|k| k.name() == name) else {
        bail!("its folder is none of urdf, toml, csv, model, line");
    };
    let bytes = std::fs::read(path)?;
    let one = |name: &str| Files::from([(name.to_string(), bytes.clone())]);
    Ok(Some((
        kind,
        match kind {
            Kind::Urdf => one("robot.urdf"),
            Kind::Toml if path.extension().is_some_and(|e| e == "urdf") => return Ok(None),
            Kind::Toml => {
                let mut files = one("robot.toml");
                files.insert("robot.urdf".into(), std::fs::read(folder.join("robot.urdf"))?);
                files
            }
            Kind::Csv => one("pendulum.csv"),
            Kind::Model => spoilt(bench, serde_json::from_slice(&bytes)?)?,
            Kind::Line => {
                let text = String::from_utf8(bytes)?;
                Files::from([("line.txt".into(), text.trim().as_bytes().to_vec())])
            }
        },
    )))
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
