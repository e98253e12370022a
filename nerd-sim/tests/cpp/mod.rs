//! Kernels as programs of this machine: their text is plain C++, too.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A compiler of C++, if the machine has one.
pub fn compiler() -> Option<&'static str> {
    ["c++", "g++", "clang++"].into_iter().find(|name| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success()))
}

/// The program of a text.
pub fn compile(compiler: &str, text: &str, folder: &Path, name: &str) -> PathBuf {
    let (source, made) = (folder.join(format!("{name}.cpp")), folder.join(name));
    std::fs::write(&source, text).expect("a file");
    let done = Command::new(compiler).args(["-O1", "-w", "-std=c++17", "-o"]).arg(&made).arg(&source).output().expect("a compiler");
    assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
    made
}

/// What it answers.
pub fn talk(made: &Path, input: Vec<u8>) -> Vec<u8> {
    let mut child = Command::new(made).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
    let mut pipe = child.stdin.take().expect("a pipe");
    let writer = std::thread::spawn(move || pipe.write_all(&input));
    let output = child.wait_with_output().expect("it ends");
    writer.join().expect("a thread").expect("it is read");
    assert!(output.status.success(), "{:?}", output.status);
    output.stdout
}
