//! Systems: a robot and its specification (all that a URDF leaves open), read from a name, a file or text.

mod build;
mod built_in;
pub mod cable;
pub(crate) mod capsules;
mod derive;
pub(crate) mod folds;
mod identity;
mod load;
mod meet;
mod merge;
pub(crate) mod mesh;
pub(crate) mod mjcf;
mod model;
pub(crate) mod motors;
mod spec;
pub(crate) mod start;
pub(crate) mod truth;
mod validate;
pub(crate) mod vary;
mod visuals;
mod world;

pub use crate::scene::GROUND;
pub(crate) use derive::stiffness;
pub use meet::contacts;
pub use model::{Source, System, SystemError, TERRAIN};
pub use spec::*;
pub use start::Start;
pub(crate) use validate::MAX_SUBSTEPS;
pub use visuals::{Geometry, Visual};
pub(crate) use world::inverse_weights;
