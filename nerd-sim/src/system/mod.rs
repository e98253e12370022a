//! A system: a robot and what its URDF cannot say, from names, files or texts.

mod build;
mod built_in;
pub mod cable;
pub(crate) mod capsules;
mod derive;
pub(crate) mod folds;
mod identity;
mod load;
mod merge;
pub(crate) mod mjcf;
mod model;
pub(crate) mod motors;
mod spec;
pub(crate) mod start;
pub(crate) mod truth;
mod validate;
pub(crate) mod vary;
mod visuals;

pub(crate) use derive::stiffness;
pub use model::{Source, System, SystemError, TERRAIN};
pub use spec::*;
pub use start::Start;
pub(crate) use validate::MOST_SUBSTEPS;
pub use visuals::{Geometry, Visual};
