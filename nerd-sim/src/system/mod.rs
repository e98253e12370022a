//! Systems: a robot and its specification (all that a URDF leaves open), read from a name, a file or text.

mod build;
mod built_in;
pub(crate) mod capsules;
pub(crate) mod folds;
mod identity;
mod load;
mod meet;
mod merge;
mod model;
pub(crate) mod start;
mod validate;
mod visuals;

pub use crate::robots::spec::*;
pub use crate::scene::GROUND;
pub use meet::contacts;
pub use model::{Source, System, SystemError, TERRAIN};
pub use start::Start;
pub(crate) use validate::MAX_SUBSTEPS;
pub use visuals::{Geometry, Visual};
