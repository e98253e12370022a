//! Kernels as programs of this machine: their text is plain C++, too.

use std::io::Write;
use std::process::{Command, Stdio};

/// A compiler of C++, and a folder for what it makes.
pub struct Compiler {
    name: &'static str,
    folder: tempfile::TempDir,
}

impl Compiler {
    pub fn find() -> Option<Self> {
        let works = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
        let Some(name) = ["c++", "g++", "clang++"].into_iter().find(works) else {
            println!("skipped: no compiler of C++ on this machine");
            return None;
        };
        Some(Self { name, folder: tempfile::tempdir().expect("a folder") })
    }

    /// What the program of a text answers to this input.
    pub fn run(&self, text: &str, input: Vec<u8>) -> Vec<u8> {
        let (source, made) = (self.folder.path().join("kernels.cpp"), self.folder.path().join("kernels"));
        std::fs::write(&source, text).expect("a file");
        let done = Command::new(self.name).args(["-O1", "-w", "-std=c++17", "-o"]).arg(&made).arg(&source).output().expect("a compiler");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let mut child = Command::new(made).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
        let mut pipe = child.stdin.take().expect("a pipe");
        let writer = std::thread::spawn(move || pipe.write_all(&input));
        let output = child.wait_with_output().expect("it ends");
        writer.join().expect("a thread").expect("it is read");
        assert!(output.status.success(), "{:?}", output.status);
        output.stdout
    }
}
