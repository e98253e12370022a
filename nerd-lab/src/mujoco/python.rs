//! MuJoCo in a Python of the user's: a script of ours runs there, is asked in JSON a line at a time, and ends with its owner.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use crate::prelude::*;

pub struct Python {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Said<A> {
    Error { error: String },
    Answer(A),
}

impl Python {
    pub fn start(python: &Path, script: &str) -> Result<Self> {
        let cannot = || format!("cannot start `{}` as a Python with MuJoCo", python.display());
        let mut command = Command::new(python);
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().with_context(cannot)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else { bail!("{}: it has no pipes", cannot()) };
        Ok(Self { child, input, output: BufReader::new(output) })
    }

    pub fn ask<A: DeserializeOwned>(&mut self, question: &impl Serialize) -> Result<A> {
        let question = serde_json::to_string(question).context("cannot ask MuJoCo")?;
        // One that has ended says why on its output.
        let _ = writeln!(self.input, "{question}");
        let mut line = String::new();
        self.output.read_line(&mut line).context("cannot hear MuJoCo")?;
        match serde_json::from_str(&line) {
            Ok(Said::Error { error }) => bail!(error.split_whitespace().collect::<Vec<_>>().join(" ")),
            Ok(Said::Answer(answer)) => Ok(answer),
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
