//! `cargo xtask check`: format, clippy, documentation, tests; stops at the first that fails.

use std::process::Command;

use anyhow::{Context, Result, bail};

/// Format, clippy, docs, tests.
#[derive(clap::Args, Clone, Debug)]
pub struct CheckArgs {
    /// Leave the tests out
    #[arg(long)]
    pub quick: bool,
}

/// Runs the verb.
pub fn run(args: CheckArgs) -> Result<()> {
    let steps: [(&str, &[&str]); 4] = [
        ("format", &["fmt", "--all", "--check"]),
        ("clippy", &["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"]),
        ("documentation", &["doc", "--release", "--workspace", "--no-deps"]),
        ("tests", &["test", "--release", "--workspace"]),
    ];
    for (what, arguments) in steps {
        if args.quick && what == "tests" {
            continue;
        }
        eprintln!("{what}: cargo {}", arguments.join(" "));
        let status = Command::new("cargo").args(arguments).env("RUSTDOCFLAGS", "-D warnings").status().context("cannot start cargo")?;
        if !status.success() {
            bail!("{what} failed");
        }
    }
    println!("all checks passed");
    Ok(())
}
