//! `cargo xtask outside`: on how many crates each package of `examples/` stands, and how long its first build takes.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use nerd_lab::report::{Artifact, Inputs, Provenance, Table};
use nerd_train::shipped::{results, root};
use serde::{Deserialize, Serialize};

/// Build the packages of `examples/` from nothing, and count what they stand on.
#[derive(clap::Args, Clone, Debug)]
pub struct OutsideArgs {
    /// Folder of the result [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// One package.
#[derive(Serialize, Deserialize)]
struct Row {
    package: String,
    stands_on: String,
    crates: usize,
    seconds: f64,
}

#[derive(Serialize, Deserialize)]
struct Data {
    rows: Vec<Row>,
}

/// The packages, and the crate that each names.
pub const PACKAGES: [(&str, &str); 4] =
    [("core-only", "nerd-core"), ("sim-only", "nerd-sim"), ("model-only", "nerd-model"), ("own-task", "nerd-train")];

/// Runs the verb.
pub fn run(args: OutsideArgs) -> Result<()> {
    let rows = PACKAGES.iter().map(|(package, stands_on)| row(package, stands_on)).collect::<Result<Vec<_>>>()?;
    let cells = rows.iter().map(|r| vec![r.package.clone(), r.stands_on.clone(), r.crates.to_string(), format!("{:.0}", r.seconds)]);
    let header = ["package", "names one crate", "crates in all", "first build (s)"];
    let note = "Crates: all that is compiled for it, itself left out. First build: `cargo build --release` into an empty folder, downloads left out.";
    let tables = vec![Table::new("outside", &header).with(cells).noted(note)];
    let artifact = Artifact { provenance: Provenance::now(0), inputs: Inputs::default(), effort: 1.0, tables, data: Data { rows } };
    artifact.write(&args.out.unwrap_or_else(results), "outside")?;
    println!("{}", artifact.markdown());
    Ok(())
}

fn row(package: &str, stands_on: &str) -> Result<Row> {
    let cargo = |verb: &str| {
        let mut cargo = Command::new("cargo");
        cargo.arg(verb).arg("--manifest-path").arg(root().join("examples/Cargo.toml")).args(["--locked", "--package", package]);
        cargo
    };
    let tree = cargo("tree").args(["--edges", "normal,build", "--prefix", "none", "--no-dedupe"]).output().context("cannot start cargo")?;
    if !tree.status.success() {
        bail!("cargo tree of {package}: {}", String::from_utf8_lossy(&tree.stderr));
    }
    let text = String::from_utf8_lossy(&tree.stdout);
    let crates: BTreeSet<Vec<&str>> = text.lines().map(|l| l.split_whitespace().take(2).collect()).collect();
    let folder = tempfile::tempdir()?;
    let started = Instant::now();
    let built = cargo("build").args(["--release", "--target-dir"]).arg(folder.path()).status().context("cannot start cargo")?;
    if !built.success() {
        bail!("{package} does not build");
    }
    Ok(Row { package: package.into(), stands_on: stands_on.into(), crates: crates.len() - 1, seconds: started.elapsed().as_secs_f64() })
}
