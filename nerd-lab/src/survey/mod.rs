//! Other people's robots: each .urdf of a folder is read as it is, on a fixed and on a free base, and rolled out from zero
//! coordinates under gravity, or refused with one line that names what is not supported. A file that cannot be read, or that we panic on,
//! gets a line too and does not stop the others.
//!
//! ```
//! let found = nerd_lab::survey::find("../nerd-sim/assets".as_ref())?;
//! let robot = nerd_lab::survey::survey(found.iter().find(|f| f.name == "pendulum.urdf").expect("it is built in"));
//! assert_eq!(robot.sizes.map(|s| (s.links, s.joints)), Some((2, 2)));
//! assert!(robot.fixed.is_ok());
//! # Ok::<(), std::io::Error>(())
//! ```

mod crowd;
mod file;
mod pinocchio;
mod stand;

use std::panic::{AssertUnwindSafe, catch_unwind};

use nerd_core::robot::{Robot, UrdfError};

pub use crowd::{CROWD, crowds};
pub use file::{Found, find};
use file::{reason, text};
pub use stand::{STANDING, stand, standing};

use crate::prelude::*;
use crate::roll::rolled;

const FRAMES: usize = 10;
/// Substeps of a frame: the accurate preset's, and where those are too coarse for a joint's damping that is stiff for what it
/// moves.
const SUBSTEPS: [usize; 2] = [4, 64];

#[derive(Clone, Debug)]
pub struct Surveyed {
    pub name: String,
    pub sizes: Option<Sizes>,
    /// Whether it moves on a fixed base: substeps a frame, 0 where it has nothing to move, or why not.
    pub fixed: Result<usize, String>,
    /// The same on a free base.
    pub floating: Result<usize, String>,
    /// The robots themselves, on a fixed and on a free base, where they can be read.
    robots: [Option<Robot>; 2],
    /// What was taken for granted, on the first of them.
    notes: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Links that move.
    pub links: usize,
    /// Joints, of one degree of freedom each.
    pub joints: usize,
    /// kg.
    pub mass: f64,
    /// Meshes that were passed over.
    pub meshes: usize,
}

/// Reads a file on both bases and rolls what it holds out.
pub fn survey(Found { path, name }: &Found) -> Surveyed {
    let text = text(path);
    // None where nothing of it moves.
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
    let robots = tries.each_ref().map(|tried| tried.as_ref().ok()?.as_ref().map(|system| system.robot.clone()));
    let [fixed, floating] = tries.map(|tried| tried?.map_or(Ok(0), |system| caught(|| roll(system, name))));
    Surveyed { name: name.clone(), sizes, fixed, floating, robots, notes }
}

/// What came of a robot; a panic is our fault, and says so.
fn caught<T>(of: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(of)).unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
        Err(format!("panic, please report: {}", said.unwrap_or_default().replace(['\n', '|'], " ")))
    })
}

fn roll(system: System, name: &str) -> Result<usize, String> {
    let system = Arc::new(system);
    let scene = system.scene("free").map_err(|e| reason(&e, name))?;
    let frames = |substeps| {
        let mut solver = Articulated::new(ArticulatedConfig { substeps, ..ArticulatedConfig::converged(Friction::Coulomb) });
        rolled(Batch::new(&system, &scene, 1), &mut solver, FRAMES).map(|_| substeps).map_err(|e| e.to_string())
    };
    frames(SUBSTEPS[0]).or_else(|_| frames(SUBSTEPS[1]))
}

/// Each file read and rolled out, a line each; with a Python that has Pinocchio, at so many states beside it. And notes of a robot that is
/// alone.
pub fn read(files: &[Found], pinocchio: Option<(&Path, usize)>) -> Result<(Vec<Table>, Vec<String>)> {
    // A panic has a line in the table; elsewhere it would tear the bar.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let robots = each(files, survey);
    std::panic::set_hook(hook);
    let header = ["file", "links", "joints", "mass (kg)", "meshes passed over", "fixed base", "floating base"];
    let sum = format!(
        "{} files: {} move on a fixed base, {} on a floating one. `ok`: {FRAMES} frames from zero coordinates under gravity, \
         `articulated`, preset `converged`, finite; else what is missing. Links and joints are those that move on a fixed base; \
         a joint has one DoF, a floating base six more.",
        files.len(),
        robots.iter().filter(|r| r.fixed.is_ok()).count(),
        robots.iter().filter(|r| r.floating.is_ok()).count()
    );
    let mut tables = vec![Table::new("urdfs", &header).with(robots.iter().map(row)).noted(&sum)];
    if let Some((python, states)) = pinocchio {
        tables.push(pinocchio::beside(python, states, files, &robots)?);
    }
    let notes = if let [robot] = &robots[..] { robot.notes.clone() } else { Vec::new() };
    Ok((tables, notes))
}

fn row(robot: &Surveyed) -> Vec<String> {
    let sizes = robot
        .sizes
        .map_or(["-"; 4].map(String::from), |s| [s.links.to_string(), s.joints.to_string(), digits(s.mass), s.meshes.to_string()]);
    let found = |moves: &Result<usize, String>| match moves {
        Ok(0) => "ok: nothing to move".into(),
        Ok(4) => "ok".into(),
        Ok(substeps) => format!("ok at {substeps} substeps"),
        Err(reason) => reason.clone(),
    };
    let floating = if robot.fixed.is_err() && robot.fixed == robot.floating { "the same".into() } else { found(&robot.floating) };
    [robot.name.clone()].into_iter().chain(sizes).chain([found(&robot.fixed), floating]).collect()
}

fn each<T>(files: &[Found], mut of: impl FnMut(&Found) -> T) -> Vec<T> {
    let bar = bar("robots", files.len() as u64);
    let one = |(k, file)| {
        bar.set(k as u64);
        of(file)
    };
    let all = files.iter().enumerate().map(one).collect();
    bar.finish();
    all
}
