//! Reads robot files, and tries whether their robots can be rolled out.

use nerd_sim::mjcf::is_mjcf;

use crate::{panics, prelude::*, roll::rolled};

pub(super) const FRAMES: usize = 10;
/// Substeps a frame that are tried in order: the preset `accurate`'s, then more for stiff joint damping on light links.
const SUBSTEPS: [usize; 2] = [4, 64];

#[derive(Clone, Debug)]
pub struct Surveyed {
    pub name: String,
    pub sizes: Option<Sizes>,
    /// Substeps a frame at which the robot can be rolled out on a fixed base, or why it cannot. 0 if nothing moves.
    pub fixed: Result<usize, String>,
    /// Like `fixed`, on a floating base.
    pub floating: Result<usize, String>,
    /// Assumptions made while reading the file; from the fixed base, or else the floating one.
    pub(super) notes: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    pub links: usize,
    /// Number of joints, each with one degree of freedom.
    pub joints: usize,
    /// Total mass (kg).
    pub mass: f64,
    pub meshes: usize,
}

/// Reads a robot file with a fixed and with a floating base, and rolls out both robots.
pub fn survey(Found { path, name }: &Found) -> Surveyed {
    let text = text(path);
    // Returns `None` if no link of the robot can move.
    let read = |floating| -> Result<Option<System>, String> {
        let text = text.as_ref().map_err(String::clone)?;
        caught(|| match System::bare_at(name, text, floating, Some(path)) {
            Err(SystemError::Urdf(_, UrdfError::Still)) => Ok(None),
            other => other.map(Some).map_err(|e| reason(&e, name)),
        })
    };
    let tries = [false, true].map(read);
    let first = tries.iter().flatten().flatten().next();
    let sizes = first.map(|System { robot, meshes, .. }| Sizes {
        links: robot.links.len(),
        joints: robot.joint_count(),
        mass: robot.mass(),
        meshes: meshes.len(),
    });
    let notes = first.map(|system| system.notes.clone()).unwrap_or_default();
    let [fixed, floating] = tries.map(|tried| tried?.map_or(Ok(0), |system| caught(|| roll(system, name))));
    Surveyed { name: name.clone(), sizes, fixed, floating, notes }
}

/// Runs `of`; a panic becomes an error that asks for a report.
pub(super) fn caught<T>(of: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    panics::caught(of).map_err(|said| format!("panic, please report: {}", said.replace('\n', " "))).flatten()
}

/// Degrees of freedom above which the implicit step is solved along the tree. With the dense matrix, a chain of a
/// thousand links takes minutes.
const DEEP: usize = 100;

fn roll(system: System, name: &str) -> Result<usize, String> {
    let system = Arc::new(system);
    let scene = system.scene("free").map_err(|e| reason(&e, name))?;
    let frames = |substeps| {
        let config = ArticulatedConfig {
            substeps,
            contact_substeps: substeps,
            ..ArticulatedConfig::converged(Friction::Coulomb)
        };
        let mut solver = Articulated::new(config);
        let mut batch = Batch::new(&system, &scene, 1);
        // Adds drives without effect, which select the implicit step along the tree.
        let idle = if system.robot.nv() > DEEP { system.robot.joint_count() } else { 0 };
        batch.drives = vec![Drive::default(); idle];
        rolled(batch, &mut solver, FRAMES).map(|_| substeps).map_err(|e| e.to_string())
    };
    frames(SUBSTEPS[0]).or_else(|_| frames(SUBSTEPS[1]))
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    pub path: PathBuf,
    /// Path relative to the searched folder.
    pub name: String,
}

/// Returns `path` if it is a file, else the .urdf files and MJCFs (.xml) below it, sorted by name. Unreadable folders
/// are listed too; links are not followed.
pub fn find(path: &Path) -> std::io::Result<Vec<Found>> {
    let above = if path.metadata()?.is_dir() { path } else { path.parent().unwrap_or(path) };
    let mut files = Vec::new();
    search(path, above, &mut files);
    Ok(files)
}

fn search(path: &Path, above: &Path, files: &mut Vec<Found>) {
    // Lists a file, or an unreadable folder as if it were a file.
    let Ok(mut inside) = std::fs::read_dir(path).and_then(Iterator::collect::<std::io::Result<Vec<_>>>) else {
        files.push(Found { path: path.into(), name: path.strip_prefix(above).unwrap_or(path).display().to_string() });
        return;
    };
    inside.sort_by_key(std::fs::DirEntry::file_name);
    for entry in inside {
        // Skips links, which may lead back to a folder above.
        let path = entry.path();
        let kind = entry.file_type();
        let robot = || match path.extension().and_then(|ending| ending.to_str()) {
            Some("urdf") => true,
            Some("xml") => text(&path).is_ok_and(|text| is_mjcf(&text)),
            _ => false,
        };
        if kind.is_ok_and(|kind| kind.is_dir() || kind.is_file() && robot()) {
            search(&path, above, files);
        }
    }
}

/// Returns the text of a file, or why it cannot be read.
pub(super) fn text(path: &Path) -> Result<String, String> {
    let bytes = nerd_sim::files::read(path).map_err(|e| format!("cannot be read: {e}"))?;
    String::from_utf8(bytes).map_err(|e| format!("is not UTF-8 text: byte {}", e.utf8_error().valid_up_to()))
}

/// Returns the error's text without the robot's name, which the table's row already has.
pub(super) fn reason(error: &impl std::fmt::Display, name: &str) -> String {
    error.to_string().replace(&format!("robot `{name}`: "), "")
}
