//! `sessions.jsonl` of a run: which updates or iterations took how long where, one line a session, appended while it goes on. A
//! run that is killed has those up to its last line.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::provenance::machine;

const FILE: &str = "sessions.jsonl";

/// One line.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Session {
    /// Updates or iterations done before.
    pub first: u64,
    /// And after.
    pub last: u64,
    /// Time between.
    pub seconds: f64,
    /// Where.
    pub machine: String,
    /// On what.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub spent: String,
}

/// Appends a session to the file of the run in `out`.
///
/// # Errors
/// If it cannot be written.
pub fn log(out: &Path, first: u64, last: u64, seconds: f64, spent: &str) -> Result<()> {
    let session = Session { first, last, seconds, machine: machine(), spent: spent.into() };
    let path = out.join(FILE);
    let cut = std::fs::read(&path).is_ok_and(|bytes| bytes.last().is_some_and(|b| *b != b'\n'));
    let line = format!("{}{}\n", if cut { "\n" } else { "" }, serde_json::to_string(&session).map_err(Error::format(&path))?);
    let file = OpenOptions::new().create(true).append(true).open(&path);
    file.and_then(|mut file| file.write_all(line.as_bytes())).map_err(Error::file(&path))
}

/// The sessions of the run in `out`. A line that was cut short by a killed process is left out, and said.
///
/// # Errors
/// If it cannot be read.
pub fn read(out: &Path) -> Result<Vec<Session>> {
    let path = out.join(FILE);
    let text = nerd_sim::files::read_text(&path).map_err(Error::file(&path))?;
    let mut sessions = Vec::new();
    for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.is_empty()) {
        match serde_json::from_str(line) {
            Ok(session) => sessions.push(session),
            Err(e) => eprintln!("{}, line {}: {e}; the minutes of that session are not counted", path.display(), number + 1),
        }
    }
    Ok(sessions)
}

/// Whether the run has any.
pub fn any(out: &Path) -> bool {
    out.join(FILE).exists()
}

/// Minutes of all of them, and the machine of the last one.
pub fn sum(sessions: &[Session]) -> (String, String) {
    let seconds: f64 = sessions.iter().map(|s| s.seconds).sum();
    (format!("{:.1}", seconds / 60.0), sessions.last().map(|s| s.machine.clone()).unwrap_or_default())
}
