//! On how many crates each package of `examples/` is built, and how long its first build takes.

use std::collections::BTreeSet;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};
use nerd_train::settings::settings;
use nerd_train::shipped::root;
use serde::Serialize;

use super::{Experiment, Measured};
use crate::error::Result;
use crate::report::{Inputs, Table};

settings! {
    /// First builds of the packages of `examples/`.
    pub struct Outside {
        /// Packages, each with the crate that it names, PACKAGE:CRATE, comma-separated
        packages: Vec<String> = PACKAGES.map(String::from).into(), Texts;
    }
}

const PACKAGES: [&str; 4] = ["core-only:nerd-core", "sim-only:nerd-sim", "model-only:nerd-model", "own-task:nerd-train"];

/// One package.
#[derive(Serialize)]
struct Row {
    package: String,
    stands_on: String,
    crates: usize,
    seconds: f64,
}

#[derive(Serialize)]
struct Data {
    rows: Vec<Row>,
}

impl Experiment for Outside {
    fn name(&self) -> String {
        "outside".into()
    }

    fn seed(&self) -> u64 {
        0
    }

    fn effort(&self) -> f64 {
        1.0
    }

    fn inputs(&self) -> Result<Inputs> {
        Ok(Inputs::default())
    }

    fn measure(&self) -> Result<Measured> {
        let rows = self.packages.iter().map(|package| row(package)).collect::<Result<Vec<_>>>()?;
        let cells = rows.iter().map(|r| vec![r.package.clone(), r.stands_on.clone(), r.crates.to_string(), format!("{:.0}", r.seconds)]);
        let note = "Crates: all that is compiled for it, itself left out. First build: `cargo build --release` into an empty folder, \
                    downloads left out.";
        let table = Table::new("outside", &["package", "names one crate", "crates in all", "first build (s)"]).with(cells).noted(note);
        Measured::new(&Data { rows }, vec![table])
    }
}

fn row(package: &str) -> Result<Row> {
    let (package, stands_on) = package.split_once(':').with_context(|| format!("packages: {package}: PACKAGE:CRATE is needed"))?;
    let cargo = |verb: &str| {
        let mut cargo = Command::new("cargo");
        cargo.arg(verb).arg("--manifest-path").arg(root().join("examples/Cargo.toml")).args(["--locked", "--package", package]);
        cargo
    };
    let tree = cargo("tree").args(["--edges", "normal,build", "--prefix", "none", "--no-dedupe"]).output().context("cannot start cargo")?;
    ensure!(tree.status.success(), "cargo tree of {package}: {}", String::from_utf8_lossy(&tree.stderr));
    let text = String::from_utf8_lossy(&tree.stdout);
    let crates: BTreeSet<Vec<&str>> = text.lines().map(|line| line.split_whitespace().take(2).collect()).collect();
    let folder = tempfile::tempdir()?;
    let started = Instant::now();
    let built = cargo("build").args(["--release", "--target-dir"]).arg(folder.path()).status().context("cannot start cargo")?;
    ensure!(built.success(), "{package} does not build");
    Ok(Row { package: package.into(), stands_on: stands_on.into(), crates: crates.len() - 1, seconds: started.elapsed().as_secs_f64() })
}
