//! `cargo xtask check`: checks format, import cycles, clippy, documentation, packages outside the workspace, and tests.
//! Stops at the first failure, and prints the time of each step.

use std::process::Command;
use std::time::{Duration, Instant};

use nerd_lab::circles;
use nerd_train::shipped::root;

use crate::prelude::*;

/// Cargo commands, cheapest first. Clippy and the documentation share compiled dependencies. The CUDA engine
/// type-checks without CUDA, and only crates with that feature are checked again. Packages outside the workspace are
/// built one at a time, each with only the features it requests.
const STEPS: [(&str, &str); 10] = [
    ("format", "fmt --all --check"),
    ("format of examples", "fmt --all --check --manifest-path examples/Cargo.toml"),
    ("clippy", "clippy --release --workspace --all-targets -- -D warnings"),
    (
        "clippy with CUDA",
        "clippy --release --workspace --all-targets --features nerd-train/cuda,xtask/cuda,nerd-py/cuda -- -D warnings",
    ),
    ("documentation", "doc --release --workspace --no-deps"),
    ("core-only", OUTSIDE),
    ("sim-only", OUTSIDE),
    ("model-only", OUTSIDE),
    ("own-task", OUTSIDE),
    ("tests", "test --release --workspace"),
];

/// Arguments that check one package outside the workspace; the package's name is appended.
const OUTSIDE: &str = "clippy --release --locked --manifest-path examples/Cargo.toml --target-dir target -p";

pub fn run() -> Result<()> {
    let started = Instant::now();
    let lines = circles::of_workspace(&root())?;
    lines.iter().for_each(|line| tell!("{line}"));
    if !lines.is_empty() {
        bail!("circles of imports");
    }
    let mut took: Vec<(&str, Duration)> = vec![("no circle of imports:", started.elapsed())];
    for (what, line) in STEPS {
        let line = if line == OUTSIDE { format!("{line} {what} -- -D warnings") } else { line.into() };
        tell!("{what}: cargo {line}");
        let started = Instant::now();
        let mut cargo = Command::new("cargo");
        cargo.args(line.split(' '));
        if what == "documentation" {
            cargo.env("RUSTDOCFLAGS", "-D warnings");
        }
        let status = cargo.status().context("cannot start cargo")?;
        took.push((what, started.elapsed()));
        if !status.success() {
            bail!("{what} failed; {}", words(&took));
        }
    }
    say!("all checks passed; {}", words(&took));
    Ok(())
}

fn words(took: &[(&str, Duration)]) -> String {
    took.iter().map(|(what, time)| format!("{what} {:.0} s", time.as_secs_f64())).join(", ")
}
