//! `cargo xtask urdf FOLDER`: other people's robots. Every .urdf below it is read as it is, on a fixed and on a free base,
//! and rolled out from zero coordinates under gravity, or refused by one line that says what it asks for that is not there.
//! No file ends the others' turn: one that cannot be read, or that we fail on, has its line, too.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use nerd_sim::prelude::*;

use crate::common::bar;
use crate::provenance::Provenance;
use crate::table::{digits, markdown};

/// Frames rolled out.
const FRAMES: usize = 10;

/// Read URDFs and roll them out.
#[derive(clap::Args, Clone, Debug)]
pub struct UrdfArgs {
    /// Files, or folders to be searched for .urdf
    #[arg(required = true)]
    pub paths: Vec<PathBuf>,
    /// Markdown file to write the table to
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: UrdfArgs) -> Result<()> {
    let mut files = Vec::new();
    for path in &args.paths {
        // Rows name a file from the folder asked for.
        let above = if path.is_dir() { path.as_path() } else { path.parent().unwrap_or(path) };
        path.metadata().with_context(|| format!("cannot read {}", path.display()))?;
        search(path, above, &mut files);
    }
    if files.is_empty() {
        bail!("no .urdf in {}", args.paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", "));
    }
    let bar = bar("robots", files.len() as u64);
    // A panic has a line in the table; elsewhere it would tear the bar.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let (mut rows, mut fine) = (Vec::new(), [0, 0]);
    for (k, (path, name)) in files.iter().enumerate() {
        bar.set(k as u64);
        let text = text(path);
        let tries = [false, true].map(|floating| match &text {
            Ok(text) => caught(|| System::bare(name, text, floating).map_err(|e| reason(&e, name))),
            Err(reason) => Err(reason.clone()),
        });
        let mut row = vec![name.clone()];
        match tries.iter().flatten().next() {
            Some(System { robot, .. }) => row.extend([
                robot.links.len().to_string(),
                robot.joint_count().to_string(),
                digits(robot.mass()),
                robot.skipped_meshes.len().to_string(),
            ]),
            None => row.extend(["-"; 4].map(String::from)),
        }
        for (system, fine) in tries.into_iter().zip(&mut fine) {
            let done = system.and_then(|system| caught(|| roll(system, name)));
            *fine += usize::from(done.is_ok());
            row.push(match done {
                Err(e) if row.last() == Some(&e) => "the same".into(),
                Ok(said) | Err(said) => said,
            });
        }
        rows.push(row);
    }
    std::panic::set_hook(hook);
    bar.finish();
    let table = markdown(&["file", "links", "joints", "mass (kg)", "meshes passed over", "fixed base", "floating base"], &rows);
    let sum = format!(
        "{} files: {} move on a fixed base, {} on a floating one. `ok`: {FRAMES} frames from zero coordinates under gravity, \
         `articulated`, preset `converged`, finite; else what is missing. Links and joints are those that move on a fixed base; \
         a joint has one DoF, a floating base six more.\n",
        files.len(),
        fine[0],
        fine[1]
    );
    println!("{table}\n{sum}");
    let Some(out) = args.out else { return Ok(()) };
    let stamp = Provenance::now(0);
    let from = format!("\n`{}`, commit {}, {}, {}\n", stamp.command, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&out, format!("# Other people's robots\n\n{sum}\n{table}{from}").as_bytes())
}

/// The text of a file, or why it has none.
fn text(path: &Path) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("cannot be read: {e}"))?;
    String::from_utf8(bytes).map_err(|e| format!("is not UTF-8 text: byte {}", e.utf8_error().valid_up_to()))
}

/// What came of a robot; a panic is our fault, and says so.
fn caught<T>(of: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(of)).unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
        Err(format!("panic, please report: {}", said.unwrap_or_default().replace(['\n', '|'], " ")))
    })
}

/// Adds `path`, or the .urdf files below it by name, with their paths from `above`; also a folder that cannot be read.
fn search(path: &Path, above: &Path, files: &mut Vec<(PathBuf, String)>) {
    let inside = if path.is_dir() { std::fs::read_dir(path).and_then(Iterator::collect::<std::io::Result<Vec<_>>>).ok() } else { None };
    let Some(mut inside) = inside else {
        files.push((path.into(), path.strip_prefix(above).unwrap_or(path).display().to_string()));
        return;
    };
    inside.sort_by_key(std::fs::DirEntry::file_name);
    for entry in inside {
        // No link is followed: it may lead back up.
        let (path, kind) = (entry.path(), entry.file_type());
        if kind.is_ok_and(|kind| kind.is_dir() || kind.is_file() && path.extension().is_some_and(|e| e == "urdf")) {
            search(&path, above, files);
        }
    }
}

/// Rolls a robot out and says how, or why not.
fn roll(system: System, name: &str) -> Result<String, String> {
    let system = Arc::new(system);
    let scene = system.scene("free").map_err(|e| reason(&e, name))?;
    let torques = vec![0.0; system.robot.joint_count()];
    let frames = |substeps| {
        let mut batch = Batch::new(&system, &scene, 1);
        let mut solver = Articulated::new(ArticulatedConfig { substeps, ..ArticulatedConfig::converged(Friction::Coulomb) });
        (0..FRAMES).try_for_each(|_| solver.step(&mut batch, &torques)).map_err(|e| e.to_string())
    };
    // RK4 at the preset's four substeps is too coarse for a joint's damping that is stiff for what it moves.
    frames(4).map(|()| "ok").or_else(|_| frames(64).map(|()| "ok at 64 substeps")).map(String::from)
}

/// What was said, without the name that stands in the row already.
fn reason(error: &SystemError, name: &str) -> String {
    error.to_string().replace(&format!("robot `{name}`: "), "").replace('|', "/")
}
