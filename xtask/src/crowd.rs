//! `cargo xtask urdf FILE ... --crowd N`: many that differ, see [`nerd_lab::survey::crowd`].

use std::path::Path;

use anyhow::{Result, bail};
use nerd_lab::report::table::digits;
use nerd_lab::report::{Artifact, Input, Inputs, Provenance, Table};
use nerd_lab::survey::{CROWD, Crowd, Found, Pace, SETTINGS, crowd};

use nerd_train::progress::bar;

/// Measures each file's robot.
pub fn run(files: &[Found], mujoco: &Path, n: usize, out: Option<&Path>) -> Result<()> {
    let (mut tables, mut failed) = (Vec::new(), Vec::new());
    for file in files {
        let bar = bar("settings", SETTINGS as u64);
        let found = crowd(file, mujoco, n, 0, &mut |done| bar.set(done as u64));
        bar.finish();
        // One that cannot be measured ends no other's turn.
        match found {
            Ok(found) => tables.push(table(file, n, &found)),
            Err(reason) => failed.push(format!("{}: {reason}", file.name)),
        }
    }
    if tables.is_empty() {
        bail!(failed.join("; "));
    }
    failed.iter().for_each(|line| eprintln!("{line}"));
    crate::out::tables(&tables);
    let Some(out) = out else { return Ok(()) };
    let (provenance, effort) = (Provenance::now(0), (files.len() * n * CROWD) as f64);
    let inputs = Inputs(vec![Input::files("URDFs", &files.iter().map(|found| found.path.clone()).collect::<Vec<_>>())?]);
    Ok(Artifact { provenance, inputs, effort, tables, data: Default::default() }.write(out, "crowd")?)
}

fn table(file: &Found, n: usize, found: &Crowd) -> Table {
    let row = |p: &Pace| {
        let beside = found.cheapest(p).map_or("-".into(), |(substeps, ratio)| format!("{} ({substeps} substeps)", digits(ratio)));
        let (joints, root, frames) = (digits(p.joints), digits(p.root), digits(p.frames));
        vec![p.engine.into(), p.substeps.to_string(), joints, root, frames, beside]
    };
    let note = format!(
        "{n} of the robot, masses of links times U(0.8, 1.2), frictions from U(0.3, 1.0), fall 2 cm onto a plane, joints up to 0.3 rad from \
         where drives hold them; {CROWD} frames of 1/60 s, one core, MuJoCo {} (IMPLICITFAST, its default contacts; elliptic cones and an impratio of 100, so that feet do not creep, or its default friction). Errors: mean \
         distance from the same engine at 256 substeps, of the first 256 robots. Last column: frames/s of ours over MuJoCo's, at ours' fewest \
         substeps that err by no more than that row in joints and in root. At 256 substeps the engines' joints are {} apart.",
        found.version,
        digits(found.apart)
    );
    let header = ["engine", "substeps", "joints (rad or m)", "root (m)", "frames/s", "ours over MuJoCo, errors no larger"];
    Table::new(&format!("crowd of {}", file.name), &header).with(found.paces.iter().map(row)).noted(&note)
}
