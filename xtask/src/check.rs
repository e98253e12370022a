//! `cargo xtask check`: format, clippy, documentation, outside packages, tests; stops at the first that fails, and says how long each took.

use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

/// Format, clippy, docs, tests.
#[derive(clap::Args, Clone, Debug)]
pub struct CheckArgs {
    /// Leave the tests out
    #[arg(long)]
    pub quick: bool,
}

/// What is asked of cargo, cheapest first. Clippy and the documentation share what they compile of the dependencies; the CUDA
/// engine needs no CUDA to be type-checked, and only what knows the feature is checked again. What stands outside the workspace is built a package at a time, each with the features that it alone asks for.
const STEPS: [(&str, &[&str]); 10] = [
    ("format", &["fmt", "--all", "--check"]),
    ("format of examples", &["fmt", "--all", "--check", "--manifest-path", "examples/Cargo.toml"]),
    ("clippy", &["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    (
        "clippy with CUDA",
        &["clippy", "--release", "--workspace", "--all-targets", "--features", "nerd-train/cuda,xtask/cuda", "--", "-D", "warnings"],
    ),
    ("documentation", &["doc", "--release", "--workspace", "--no-deps"]),
    ("core-only", &outside("core-only")),
    ("sim-only", &outside("sim-only")),
    ("model-only", &outside("model-only")),
    ("own-task", &outside("own-task")),
    ("tests", &["test", "--release", "--workspace"]),
];

const fn outside(package: &'static str) -> [&'static str; 12] {
    let shared = ["clippy", "--release", "--locked", "--manifest-path", "examples/Cargo.toml", "--target-dir", "target", "-p"];
    let [a, b, c, d, e, f, g, h] = shared;
    [a, b, c, d, e, f, g, h, package, "--", "-D", "warnings"]
}

/// Runs the verb.
pub fn run(args: CheckArgs) -> Result<()> {
    let mut took: Vec<(&str, Duration)> = Vec::new();
    for (what, arguments) in STEPS.into_iter().filter(|(what, _)| !(args.quick && *what == "tests")) {
        eprintln!("{what}: cargo {}", arguments.join(" "));
        let started = Instant::now();
        let mut cargo = Command::new("cargo");
        cargo.args(arguments);
        if what == "documentation" {
            cargo.env("RUSTDOCFLAGS", "-D warnings");
        }
        let status = cargo.status().context("cannot start cargo")?;
        took.push((what, started.elapsed()));
        if !status.success() {
            bail!("{what} failed; {}", words(&took));
        }
    }
    println!("all checks passed; {}", words(&took));
    Ok(())
}

fn words(took: &[(&str, Duration)]) -> String {
    took.iter().map(|(what, time)| format!("{what} {:.0} s", time.as_secs_f64())).collect::<Vec<_>>().join(", ")
}
