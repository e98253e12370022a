//! `cargo xtask urdf FOLDER`: other people's robots, see [`nerd_lab::survey`].

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use nerd_lab::report::{Artifact, Input, Inputs, Provenance};
use nerd_lab::survey::{beside, find, read};

#[derive(clap::Args, Clone, Debug)]
pub struct UrdfArgs {
    /// Files, or folders to be searched for .urdf and MJCF (.xml)
    #[arg(required = true)]
    pub paths: Vec<PathBuf>,
    /// Instead compare masses, contact and accelerations with those of MuJoCo, by a Python that has it
    #[arg(long, value_name = "PYTHON")]
    pub mujoco: Option<PathBuf>,
    /// Folder to write the table into
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

pub fn run(args: UrdfArgs) -> Result<()> {
    let mut files = Vec::new();
    for path in &args.paths {
        files.extend(find(path).with_context(|| format!("cannot read {}", path.display()))?);
    }
    if files.is_empty() {
        bail!("no .urdf or MJCF in {}", args.paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", "));
    }
    let effort = files.len() as f64;
    let (name, (table, notes)) = match &args.mujoco {
        Some(python) => ("beside_mujoco", (beside(&files, python), Vec::new())),
        None => ("urdfs", read(&files)),
    };
    let tables = vec![table];
    crate::out::tables(&tables);
    notes.iter().for_each(|note| tell!("{note}"));
    let Some(out) = args.out else { return Ok(()) };
    let inputs = Inputs(vec![Input::files("URDFs", &files.into_iter().map(|found| found.path).collect::<Vec<_>>())?]);
    let (provenance, data) = (Provenance::now(0), Default::default());
    Artifact { provenance, inputs, effort, tables, data }.write(&out, name)
}
