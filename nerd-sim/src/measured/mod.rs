//! 537 real tosses of an acrylic cube (ContactNets), predicted open loop from measured states: how far is a solver from the
//! world?
//!
//! [`read`] the tosses, cut them into [`windows`] (or take them [`whole`]), [`roll`] them out under any solver, and hold the
//! motions [`against`] what was measured. The body is the published one, [`Cube`]; [`fit`] chooses what nobody published.
//!
//! ```no_run
//! use nerd_sim::{measured::*, prelude::*};
//! let tosses = read("data/cube-toss".as_ref())?;
//! let trials = lifted(&windows(&tosses, 4, 1.0));
//! let implicit = ArticulatedConfig::implicit(16, Friction::Coulomb);
//! let (motions, _) = roll(&Cube::default().system()?, &|_| Box::new(Articulated::new(implicit)), &trials)?;
//! let score = against(&trials, &motions);
//! println!("{:.4} m, {:.3} rad", score.position, score.rotation); // 0.0110 m, 0.228 rad
//! # Ok::<(), MeasuredError>(())
//! ```

mod cube;
mod data;
mod fit;
mod noise;
mod protocol;
mod score;

use std::path::PathBuf;

pub use cube::{Cube, EDGE, FRICTION, INERTIA, MASS, RESTITUTION, SOLID, lowest};
pub use data::{DT, Sample, Toss, read};
pub use fit::{Fit, fit, half};
pub use noise::{Noise, aged, disturbed, noise};
pub use protocol::{METRIC, Make, Motion, Trial, WINDOW, flight, lifted, roll, still, whole, windows};
pub use score::{Score, against, score};

use crate::system::SystemError;
use crate::table::TableError;

/// Why real motions could not be read or predicted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasuredError {
    /// A file of the tosses is not there.
    #[error("no toss data: {} is absent; name the folder that holds tosses.csv and tosses_meta.csv", .0.display())]
    Absent(PathBuf),
    /// A table that cannot be read.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A cube that is none, or that has no table.
    #[error(transparent)]
    System(#[from] SystemError),
}
