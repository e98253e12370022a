//! `cargo xtask check-robots FOLDER`: reads other people's robots, see [`crate::survey`].

use crate::prelude::*;
use crate::report::{Artifact, Provenance};
use crate::survey::{beside, find, read};

#[derive(clap::Args)]
pub struct CheckRobotsArgs {
    /// URDF and MJCF (.xml) files, or folders to search for them
    #[arg(required = true, value_name = "PATH")]
    pub paths: Vec<PathBuf>,
    /// Python that has MuJoCo. Compares masses, contacts and accelerations with MuJoCo's, in place of the rollouts
    #[arg(long)]
    pub mujoco: Option<PathBuf>,
    /// Folder to write the table into; without it the table is only printed
    #[arg(long)]
    pub out: Option<PathBuf>,
}

pub fn run(args: CheckRobotsArgs) -> Result<()> {
    let mut files = Vec::new();
    for path in &args.paths {
        files.extend(find(path).with_context(|| format!("cannot read {}", path.display()))?);
    }
    if files.is_empty() {
        bail!("no .urdf or MJCF in {}", args.paths.iter().map(|p| p.display().to_string()).join(", "));
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
    let inputs = Inputs(vec![Input::files("URDFs", &files.into_iter().map(|found| found.path).collect_vec())?]);
    let provenance = Provenance::now(0);
    let data = Default::default();
    Artifact { provenance, inputs, effort, tables, data }.write(&out, name)
}
