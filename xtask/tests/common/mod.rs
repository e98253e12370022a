//! The program as its users call it.

use std::path::Path;
use std::process::{Command, Output};

/// Runs it in the workspace's root.
pub fn xtask(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("workspace");
    Command::new(env!("CARGO_BIN_EXE_xtask")).args(args).current_dir(root).output().expect("xtask starts")
}

/// Runs what must be refused: exit code 2 and one line that names the culprit.
pub fn refused(args: &[&str], culprit: &str) {
    let run = xtask(args);
    let error = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{args:?}: {error}");
    assert!(error.trim_end().lines().count() == 1 && error.contains(culprit), "{args:?}: `{error}` is not one line that names {culprit}");
}
