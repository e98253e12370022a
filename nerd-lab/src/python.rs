//! Another engine in a Python of the user's: a script of ours runs there, is asked in JSON a line at a time, and ends with its owner.

use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, bail};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub struct Python {
    engine: &'static str,
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

/// What every script says of its engine first.
#[derive(Deserialize)]
pub struct Version {
    pub version: String,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Said<A> {
    Error { error: String },
    Answer(A),
}

impl Python {
    pub fn start(python: &Path, script: &str, engine: &'static str) -> Result<Self> {
        let cannot = || format!("cannot start `{}` as a Python with {engine}", python.display());
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().with_context(cannot)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else { bail!("{}: it has no pipes", cannot()) };
        Ok(Self { engine, child, input, output: BufReader::new(output) })
    }

    pub fn ask<A: DeserializeOwned>(&mut self, question: &impl Serialize) -> Result<A> {
        let question = serde_json::to_string(question).with_context(|| format!("cannot ask {}", self.engine))?;
        // One that has ended says why on its output.
        let _ = writeln!(self.input, "{question}");
        self.answer()
    }

    /// Numbers for the script to read as little-endian f64.
    pub fn send(&mut self, numbers: &[f64]) -> io::Result<()> {
        self.input.write_all(&numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())
    }

    /// The next line that it says.
    pub fn answer<A: DeserializeOwned>(&mut self) -> Result<A> {
        let mut line = String::new();
        self.output.read_line(&mut line).with_context(|| format!("cannot hear {}", self.engine))?;
        match serde_json::from_str(&line) {
            Ok(Said::Error { error }) => bail!(error.split_whitespace().collect::<Vec<_>>().join(" ")),
            Ok(Said::Answer(answer)) => Ok(answer),
            Err(_) => bail!("the Python of {} ended without an answer", self.engine),
        }
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
