//! Records of a run, with one JSON object per line. `metrics.jsonl` has the run's progress, `sessions.jsonl` its times
//! by machine. In `metrics.jsonl`, `step` is the number of updates done. A resumed run drops the lines after its
//! checkpoint, since it writes them again.

use std::fs::{File, OpenOptions};
use std::io::Write;

use nerd_sim::files::{Claim, claim, has_keys, unclaimed};

use crate::files::{read_record, write};
use crate::prelude::*;
use crate::provenance::{Provenance, machine};

/// Claims a folder, so that only this process writes to it.
pub fn claimed(folder: &Path) -> Result<Claim> {
    claim(folder).map_err(|e| Error::Refused(format!("--out: {e}")))
}

/// Names of the files and folders of a run.
const OWN: [&str; 7] =
    ["run.json", "metrics.jsonl", "sessions.jsonl", "last.safetensors", "best.safetensors", "model", "policy"];

/// Refuses a folder with files named as a run's files that no run has written.
pub fn ours(folder: &Path) -> Result<()> {
    let checkpoint = |name: &str| Tensors::open(&folder.join(name)).is_ok_and(|file| file.word("config").is_ok());
    let keys: [(&str, &[&str]); 4] = [
        ("run.json", &["robot_sha256", "learner"]),
        ("run.json", &["run", "seed", "settings"]),
        ("model/config.json", &["model_sha256", "network"]),
        ("policy/config.json", &["ppo", "shape"]),
    ];
    let known = || {
        keys.iter().any(|(name, keys)| has_keys(&folder.join(name), keys))
            || ["last.safetensors", "best.safetensors"].map(checkpoint).contains(&true)
    };
    unclaimed(folder, &OWN, known).map_err(|e| Error::Refused(format!("--out: {e}")))
}

/// A record file, open for appending.
#[derive(Debug)]
pub struct Record {
    path: PathBuf,
    file: File,
}

impl Record {
    /// Opens or creates the metrics of a run that has done `step` updates. Drops the lines of later steps, and a line
    /// truncated by a killed process.
    pub fn metrics(folder: &Path, step: u64) -> Result<Self> {
        let path = folder.join("metrics.jsonl");
        if path.exists() {
            let text = read_record(&path)?;
            let of = |line: &str| serde_json::from_str::<serde_json::Value>(line).ok()?.get("step")?.as_u64();
            let kept: String =
                text.lines().filter(|l| of(l).is_some_and(|s| s <= step)).flat_map(|l| [l, "\n"]).collect();
            write(&path, kept)?;
        }
        Self::append(path)
    }

    fn append(path: PathBuf) -> Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(Error::file(&path))?;
        Ok(Self { path, file })
    }

    /// Appends one line.
    pub fn write(&mut self, line: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string(line).map_err(Error::file(&self.path))?;
        self.file.write_all(format!("{text}\n").as_bytes()).map_err(Error::file(&self.path))
    }
}

/// A stretch of a run in one process, for example between two validations.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Session {
    /// Updates or iterations done at the start.
    pub first: u64,
    /// Updates or iterations done at the end.
    pub last: u64,
    /// Duration of the session (s).
    pub seconds: f64,
    /// Name of the machine: GPU, processor and number of cores.
    pub machine: String,
    /// Time spent in each part of the work, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub spent: String,
}

fn sessions(out: &Path) -> PathBuf {
    out.join("sessions.jsonl")
}

impl Session {
    /// Appends a session to the record of the run in `out`.
    pub fn log(out: &Path, first: u64, last: u64, seconds: f64, spent: &str) -> Result<()> {
        let path = sessions(out);
        let cut = std::fs::read(&path).is_ok_and(|bytes| bytes.last().is_some_and(|b| *b != b'\n'));
        let mut record = Record::append(path)?;
        if cut {
            record.file.write_all(b"\n").map_err(Error::file(&record.path))?;
        }
        record.write(&Self { first, last, seconds, machine: machine(), spent: spent.into() })
    }

    /// All sessions of the run in `out`. A line truncated by a killed process is left out and reported.
    pub fn all(out: &Path) -> Result<Vec<Self>> {
        let path = sessions(out);
        let text = read_record(&path)?;
        let mut all = Vec::new();
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.is_empty()) {
            match serde_json::from_str(line) {
                Ok(session) => all.push(session),
                Err(e) => {
                    tell!("{}, line {}: {e}; the minutes of that session are not counted", path.display(), number + 1)
                }
            }
        }
        Ok(all)
    }

    /// Whether the run has a record of sessions.
    pub fn any(out: &Path) -> bool {
        sessions(out).exists()
    }
}

/// Rows of a model card on the run in `out`, by name and as a Markdown table. `own` are further rows.
pub(crate) fn rows(out: &Path, seed: u64, own: Vec<(&str, String)>) -> Result<(BTreeMap<String, String>, String)> {
    let sessions = Session::all(out)?;
    let minutes = format!("{:.1}", sessions.iter().map(|s| s.seconds).sum::<f64>() / 60.0);
    let machine = sessions.last().map(|s| s.machine.clone()).unwrap_or_default();
    let Provenance { commit, command, date, .. } = Provenance::now(seed);
    let seed = seed.to_string();
    let mut rows = vec![
        ("commit", commit),
        ("command", command),
        ("seed", seed),
        ("machine", machine),
        ("minutes", minutes),
        ("date", date),
    ];
    rows.extend(own);
    let table: String = rows.iter().map(|(name, value)| format!("| {name} | {value} |\n")).collect();
    Ok((rows.into_iter().map(|(name, value)| (name.into(), value)).collect(), format!("| | |\n|---|---|\n{table}")))
}
