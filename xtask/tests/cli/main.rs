//! The program as its users call it: refusals, results, and statements of the repository's documents.

mod browser;
mod campaign;
mod live;
mod project;
mod refusals;
mod report;
mod robots;
mod runs;
mod solvers;
mod words;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace")
}

/// The program, run in the workspace, with the words of `line` and `paths` as arguments.
fn command(line: &str, paths: &[&Path]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(line.split_whitespace()).args(paths).current_dir(root());
    command
}

fn output(line: &str, paths: &[&Path]) -> Output {
    command(line, paths).output().expect("xtask starts")
}

/// Runs a command that must succeed; returns standard output and standard error.
fn done(line: &str, paths: &[&Path]) -> (String, String) {
    let run = output(line, paths);
    let [out, err] = [run.stdout, run.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(run.status.success(), "{line}: {err}");
    (out, err)
}

/// Runs a command that must be refused: exit code 1 or 2 and one line that names the culprit.
fn refused(line: &str, paths: &[&Path], culprit: &str) {
    let run = output(line, paths);
    let error = String::from_utf8_lossy(&run.stderr);
    assert!(matches!(run.status.code(), Some(1 | 2)), "{line}: {error}");
    assert!(
        error.trim_end().lines().count() == 1 && error.contains(culprit),
        "{line}: `{error}` is not one line that names {culprit}"
    );
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), bytes).expect("written");
        self.path(name)
    }
}

fn text(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    String::from_utf8_lossy(&bytes(path)).into_owned()
}

fn bytes(path: impl AsRef<Path>) -> Vec<u8> {
    let path = path.as_ref();
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn json(path: impl AsRef<Path>) -> serde_json::Value {
    serde_json::from_slice(&bytes(path)).expect("JSON")
}
