//! MuJoCo in a Python process, started on demand: a line of JSON asks, a line answers.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use crate::prelude::*;

/// The program that loads a model in MuJoCo and steps it.
pub const REFEREE: &str = include_str!("referee.py");

pub struct Python {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Said<A> {
    Error { error: String },
    Answer { answer: A },
}

impl Python {
    pub fn start(python: &Path, script: &str) -> Result<Self> {
        let cannot = || format!("cannot start `{}` as a Python with MuJoCo", python.display());
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().with_context(cannot)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            bail!("{}: it has no pipes", cannot())
        };
        Ok(Self { child, input, output: BufReader::new(output) })
    }

    /// Starts MuJoCo with a `model` (`mjcf` or `path`, and `frame_time`), without start states.
    pub fn of_model(python: &Path, mut model: Value) -> Result<Self> {
        model["frames"] = json!(0);
        model["starts"] = json!([]);
        let mut python = Self::start(python, REFEREE)?;
        python.ask::<String>(&model)?;
        Ok(python)
    }

    pub fn process(&self) -> u32 {
        self.child.id()
    }

    pub fn ask<A: DeserializeOwned>(&mut self, question: &Value) -> Result<A> {
        // Ignores a failed write: a process that has ended left its error on standard output, which is read next.
        let _ = writeln!(self.input, "{question}");
        let mut line = String::new();
        self.output.read_line(&mut line).context("cannot hear MuJoCo")?;
        match serde_json::from_str(&line) {
            Ok(Said::Error { error }) => bail!(error.split_whitespace().join(" ")),
            Ok(Said::Answer { answer }) => Ok(answer),
            Err(_) => bail!("the Python of MuJoCo ended without an answer"),
        }
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
