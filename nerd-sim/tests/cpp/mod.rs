//! Runs CUDA kernels on the CPU: their text is also plain C++.

// Each test file is a crate and uses a part of this.
#![allow(dead_code)]

use std::io::Write;
use std::process::{Command, Stdio};

/// CUDA's names, for kernels in blocks of one thread that run one after the other.
const NAMES: &str = "#include <cmath>
#include <cstdio>
#include <vector>
#define __global__
#define __shared__
#define __align__(bytes)
#define __launch_bounds__(threads)
struct Place { int x, y; };
static Place blockIdx, threadIdx, blockDim = {1, 1}, gridDim;
struct Buffer { long long size; std::vector<double> room; template <class T> operator T*() { return (T*)room.data(); } };
";

/// Reads buffers `b` before launches; `END` writes them after.
const BEGIN: &str = "
int main() {
    int count = 0;
    std::fread(&count, 4, 1, stdin);
    std::vector<Buffer> b(count);
    for (Buffer& own : b) {
        std::fread(&own.size, 8, 1, stdin);
        own.room.resize(own.size / 8 + 1);
        if (std::fread(own.room.data(), 1, own.size, stdin) != (size_t)own.size) return 1;
    }
";
const END: &str = "
    for (Buffer& own : b) std::fwrite(own.room.data(), 1, own.size, stdout);
}
";

/// A C++ compiler, and a folder for its output.
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

    /// Output of the compiled program for this input.
    pub fn run(&self, text: &str, input: Vec<u8>) -> Vec<u8> {
        let (source, made) = (self.folder.path().join("kernels.cpp"), self.folder.path().join("kernels"));
        std::fs::write(&source, text).expect("a file");
        let done = Command::new(self.name)
            .args(["-O1", "-w", "-std=c++17", "-o"])
            .arg(&made)
            .arg(&source)
            .output()
            .expect("a compiler");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let mut child = Command::new(made).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("it starts");
        let mut pipe = child.stdin.take().expect("a pipe");
        let writer = std::thread::spawn(move || pipe.write_all(&input));
        let output = child.wait_with_output().expect("it ends");
        writer.join().expect("a thread").expect("it is read");
        assert!(output.status.success(), "{:?}", output.status);
        output.stdout
    }

    /// Content of the buffers after a text's kernels ran. The lines of `launches` refer to buffers as `b[0]`, `b[1]`
    /// and so on.
    pub fn launch(&self, text: &str, launches: &str, buffers: &[Vec<u8>]) -> Vec<Vec<u8>> {
        let mut input = (buffers.len() as i32).to_le_bytes().to_vec();
        buffers.iter().for_each(|b| input.extend((b.len() as i64).to_le_bytes().iter().chain(b)));
        let output = self.run(&[NAMES, text, BEGIN, launches, END].concat(), input);
        let mut rest = output.into_iter();
        buffers.iter().map(|b| rest.by_ref().take(b.len()).collect()).collect()
    }
}

pub fn bytes<T: Copy, const N: usize>(numbers: &[T], of: fn(T) -> [u8; N]) -> Vec<u8> {
    numbers.iter().flat_map(|x| of(*x)).collect()
}

pub fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

pub fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}
