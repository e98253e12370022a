//! Surveys third-party robots: reads each URDF or MJCF of a folder with a fixed and a floating base. Each robot is
//! rolled out from zero coordinates under gravity. Unsupported features, unreadable files and panics are reported in
//! the file's row, and the other files are still read.
//!
//! ```
//! let found = nerd_cli::survey::find("../nerd-sim/assets".as_ref())?;
//! let robot = nerd_cli::survey::survey(found.iter().find(|f| f.name == "pendulum.urdf").expect("it is built in"));
//! assert_eq!(robot.sizes.map(|s| (s.links, s.joints)), Some((2, 2)));
//! assert!(robot.fixed.is_ok());
//! # Ok::<(), std::io::Error>(())
//! ```

mod beside;
mod robot;
mod stand;

pub use beside::beside;
use robot::FRAMES;
pub use robot::{Found, Sizes, Surveyed, find, survey};
pub use stand::verdict;

use crate::{panics::silent, prelude::*};

/// Reads and rolls out each file; the table has one row for each. Also returns the notes of the file if there is only
/// one.
pub fn read(files: &[Found]) -> (Table, Vec<String>) {
    let robots = each(files, survey);
    let header = ["file", "links", "joints", "mass (kg)", "meshes passed over", "fixed base", "floating base"];
    let sum = format!(
        "{} files: {} move on a fixed base, {} on a floating one. `ok`: {FRAMES} frames from zero coordinates under gravity, \
         `articulated`, preset `converged`, finite; else what is missing. Links and joints are those that move on a fixed base; \
         a joint has one DoF, a floating base six more.",
        files.len(),
        robots.iter().filter(|r| r.fixed.is_ok()).count(),
        robots.iter().filter(|r| r.floating.is_ok()).count()
    );
    let table = Table::new("urdfs", header).with(robots.iter().map(row)).noted(sum);
    (table, if let [robot] = &robots[..] { robot.notes.clone() } else { Vec::new() })
}

fn row(robot: &Surveyed) -> Vec<String> {
    let sizes = robot.sizes.map_or(["-"; 4].map(String::from), |s| {
        [s.links.to_string(), s.joints.to_string(), digits(s.mass), s.meshes.to_string()]
    });
    let found = |moves: &Result<usize, String>| match moves {
        Ok(0) => "ok: nothing to move".into(),
        Ok(4) => "ok".into(),
        Ok(substeps) => format!("ok at {substeps} substeps"),
        Err(reason) => reason.clone(),
    };
    let floating =
        if robot.fixed.is_err() && robot.fixed == robot.floating { "the same".into() } else { found(&robot.floating) };
    [robot.name.clone()].into_iter().chain(sizes).chain([found(&robot.fixed), floating]).collect()
}

/// Applies `of` to each file under a progress bar, without printing panics.
fn each<T>(files: &[Found], of: impl FnMut(&Found) -> T) -> Vec<T> {
    let bar = bar("robots", files.len() as u64);
    let all = silent(|| files.iter().map(of).inspect(|_| bar.add(1)).collect());
    bar.finish();
    all
}
