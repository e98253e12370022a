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
pub mod tables;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use nerd_core::robot::{Robot, UrdfError};
use nerd_sim::prelude::*;

pub use crowd::{CROWD, Crowd, Pace, SETTINGS, crowd};
pub use file::{Found, find};
use file::{reason, text};
pub use pinocchio::{Differences, PinocchioError, differences};
pub use stand::{Course, Limp, STANDING, Standing, stand};

/// Frames rolled out.
pub const FRAMES: usize = 10;
/// Substeps of a frame: the accurate preset's, and where those are too coarse for a joint's damping that is stiff for what it
/// moves.
const SUBSTEPS: [usize; 2] = [4, 64];

/// What came of a file.
#[derive(Clone, Debug)]
pub struct Surveyed {
    /// The file's name.
    pub name: String,
    /// Of the robot, where it can be read.
    pub sizes: Option<Sizes>,
    /// Whether it moves on a fixed base: substeps a frame, 0 where it has nothing to move, or why not.
    pub fixed: Result<usize, String>,
    /// Whether it moves on a free base.
    pub floating: Result<usize, String>,
    /// The robots themselves, on a fixed and on a free base, where they can be read.
    pub robots: [Option<Robot>; 2],
    /// What was taken for granted, on the first of them.
    pub notes: Vec<String>,
}

/// Of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Links that move.
    pub links: usize,
    /// Joints, of one degree of freedom each.
    pub joints: usize,
    /// Mass (kg).
    pub mass: f64,
    /// Meshes that were passed over.
    pub meshes: usize,
}

/// Reads a file on both bases and rolls what it holds out.
pub fn survey(Found { path, name }: &Found) -> Surveyed {
    let text = text(path);
    let read = |floating| -> Result<System, Unread> {
        let text = text.as_ref().map_err(|e| Unread::Because(e.clone()))?;
        let read = || match System::bare_at(name, text, floating, Some(path)) {
            Err(SystemError::Urdf(_, UrdfError::Still)) => Ok(None),
            other => other.map(Some).map_err(|e| reason(&e, name)),
        };
        caught(read).map_err(Unread::Because)?.ok_or(Unread::Still)
    };
    let tries = [false, true].map(read);
    let sizes = tries.iter().flatten().next().map(|System { robot, meshes, .. }| Sizes {
        links: robot.links.len(),
        joints: robot.joint_count(),
        mass: robot.mass(),
        meshes: meshes.len(),
    });
    let notes = tries.iter().flatten().next().map(|system| system.notes.clone()).unwrap_or_default();
    let roll = |system: Result<System, Unread>| match system {
        Ok(system) => caught(|| roll(system, name)),
        Err(Unread::Still) => Ok(0),
        Err(Unread::Because(reason)) => Err(reason),
    };
    let robots = [0, 1].map(|k: usize| tries[k].as_ref().ok().map(|system| system.robot.clone()));
    let [fixed, floating] = tries.map(roll);
    Surveyed { name: name.clone(), sizes, fixed, floating, robots, notes }
}

/// Why there is no robot to roll out.
enum Unread {
    /// Nothing of it moves.
    Still,
    /// A line.
    Because(String),
}

/// What came of a robot; a panic is our fault, and says so.
fn caught<T>(of: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(of)).unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<&str>().map(ToString::to_string).or_else(|| panic.downcast_ref::<String>().cloned());
        Err(format!("panic, please report: {}", said.unwrap_or_default().replace(['\n', '|'], " ")))
    })
}

/// Rolls a robot out at the fewest substeps that do.
fn roll(system: System, name: &str) -> Result<usize, String> {
    let system = Arc::new(system);
    let scene = system.scene("free").map_err(|e| reason(&e, name))?;
    let torques = vec![0.0; system.robot.joint_count()];
    let frames = |substeps| {
        let mut batch = Batch::new(&system, &scene, 1);
        let mut solver = Articulated::new(ArticulatedConfig { substeps, ..ArticulatedConfig::converged(Friction::Coulomb) });
        (0..FRAMES).try_for_each(|_| solver.step(&mut batch, &torques)).map(|()| substeps).map_err(|e| e.to_string())
    };
    frames(SUBSTEPS[0]).or_else(|_| frames(SUBSTEPS[1]))
}
