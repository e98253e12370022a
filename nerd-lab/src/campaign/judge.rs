//! A case is used as its command line says, in a folder of its own, and what it leaves is looked at.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Result;
use nerd_model::folder::Model;
use nerd_sim::prelude::*;
use safetensors::tensor::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::bench::write;

/// The program, called with the words of a command line; an error in words.
pub type Call = fn(&[&str]) -> Result<(), String>;

/// Files by name.
pub type Files = BTreeMap<String, Vec<u8>>;

/// Files, and the command line that uses them, after some that prepare.
pub struct Case {
    pub files: Files,
    pub before: Vec<String>,
    pub line: String,
}

impl Case {
    /// What stands behind an option.
    pub fn value(&self, option: &str) -> Option<&str> {
        self.line.split(' ').skip_while(|word| *word != option).nth(1)
    }
}

/// What became of a case: its column, and words.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Verdict(pub Outcome, pub String);

/// Whatever comes behind `Accepted` must not happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Outcome {
    Refused,
    Accepted,
    Panic,
    /// The process died of a signal.
    Abort,
    Memory,
    Time,
    /// A number that is not finite came out.
    NotFinite,
    /// A refusal left files or had no words, or a result is not whole.
    Untidy,
}

impl Outcome {
    /// Columns of all.
    pub const NAMES: [&str; 8] = ["refused", "accepted", "panics", "aborts", "over memory", "over time", "not finite", "untidy"];

    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

/// Longest refusal (bytes): somebody is to read it.
const WORDS: usize = 10_000;
/// In the words of a number that is not finite.
const NOT_FINITE: &str = "not finite";

/// Uses a case in the folder that this process is in, which it empties.
pub fn judge(case: &Case, call: Call) -> Result<Verdict> {
    let here = std::env::current_dir()?;
    for entry in std::fs::read_dir(&here)? {
        let path = entry?.path();
        if path.is_dir() { std::fs::remove_dir_all(path)? } else { std::fs::remove_file(path)? }
    }
    write(&here, &case.files)?;
    std::fs::write("there", "x")?;
    #[cfg(unix)]
    std::os::unix::fs::symlink("/dev/null", "null")?;
    case.before.iter().try_for_each(|line| prepare(line, call))?;
    let had = below(&here)?;
    let words: Vec<&str> = case.line.split_whitespace().map(|word| if word == "''" { "" } else { word }).collect();
    let ended = call(&words);
    let left: Vec<PathBuf> = below(&here)?.into_iter().filter(|path| !had.contains(path)).collect();
    let kept = std::fs::read("there").is_ok_and(|text| text == b"x") && Path::new("null").is_symlink();
    let (outcome, words) = match ended {
        Ok(()) => match left.iter().try_for_each(|path| whole(path)) {
            Ok(()) => (Outcome::Accepted, String::new()),
            Err(words) => (if words.contains(NOT_FINITE) { Outcome::NotFinite } else { Outcome::Untidy }, words),
        },
        Err(words) if words.is_empty() || words.len() > WORDS => (Outcome::Untidy, format!("a refusal of {} bytes", words.len())),
        Err(words) if !left.is_empty() || case.before.is_empty() && Path::new("out").exists() => {
            (Outcome::Untidy, format!("a refusal left {left:?}: {words}"))
        }
        Err(words) if !kept => (Outcome::Untidy, format!("a refusal replaced a file: {words}")),
        Err(words) => (Outcome::Refused, words),
    };
    Ok(Verdict(outcome, words))
}

/// A line that must succeed: the program's; `rm FILE`; `cut FILE`, which takes a file's second half away; `stamp FOLDER`, which makes a
/// model's hash fit, since loading refuses any other change first.
fn prepare(line: &str, call: Call) -> Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(file)?,
        Some(("cut", file)) => {
            let bytes = std::fs::read(file)?;
            std::fs::write(file, &bytes[..bytes.len() / 2])?;
        }
        Some(("stamp", folder)) => {
            let (system, folder) = (System::named("pendulum")?, Path::new(folder));
            if let Ok(mut model) = Model::read(folder, &system, None) {
                model.stamp(&system);
                std::fs::write(folder.join("config.json"), serde_json::to_string(&model.config)?)?;
            }
        }
        _ => call(&line.split(' ').collect::<Vec<_>>()).map_err(|words| anyhow::anyhow!("`{line}` failed: {words}"))?,
    }
    Ok(())
}

/// Says what is wrong with a file that the program wrote, by its ending: it ends where it should, and holds numbers where it should.
pub fn whole(path: &Path) -> Result<(), String> {
    let wrong = |reason: String| format!("{}: {reason}", path.file_name().unwrap_or_default().to_string_lossy());
    let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
    let json = |text: &[u8]| serde_json::from_slice::<serde_json::Value>(text).map(drop).map_err(|e| e.to_string());
    let checked = match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
        "json" => json(&bytes),
        // Of a log that grows line by line the last one may be cut.
        "jsonl" => bytes.split_inclusive(|b| *b == b'\n').filter(|line| line.ends_with(b"\n")).try_for_each(json),
        "csv" if bytes.last().is_some_and(|b| *b != b'\n') => Err("no end".into()),
        "csv" => {
            let odd = |cell: &&str| cell.trim().parse::<f64>().is_ok_and(|x| !x.is_finite());
            let text = String::from_utf8_lossy(&bytes);
            text.split([',', '\n']).find(odd).map_or(Ok(()), |cell| Err(format!("holds {cell}, which is {NOT_FINITE}")))
        }
        "safetensors" => tensors(&bytes),
        "tmp" => Err("left over".into()),
        _ => Ok(()),
    };
    checked.map_err(wrong)
}

/// Distances in empty space are infinite.
fn tensors(bytes: &[u8]) -> Result<(), String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let finite = |view: &safetensors::tensor::TensorView| match view.dtype() {
        Dtype::F32 => view.data().as_chunks().0.iter().all(|b| f32::from_le_bytes(*b).is_finite()),
        Dtype::F64 => view.data().as_chunks().0.iter().all(|b| f64::from_le_bytes(*b).is_finite()),
        _ => true,
    };
    let wrong = file.tensors().into_iter().find(|(name, view)| !name.contains("depths") && !finite(view));
    wrong.map_or(Ok(()), |(name, _)| Err(format!("`{name}` is {NOT_FINITE}")))
}

/// Every file below a folder, in order; no link is followed. None below one that is not there.
pub fn below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    if !folder.exists() {
        return Ok(found);
    }
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => found.extend(below(&entry.path())?),
            false => found.push(entry.path()),
        }
    }
    found.sort();
    Ok(found)
}
