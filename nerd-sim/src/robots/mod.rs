//! Robots' files: MJCF, meshes, the keys of a TOML, cables, and settings derived where no file gives them. `system/`
//! builds a [`System`](crate::system::System) from them.

pub mod cable;
pub(crate) mod derive;
pub(crate) mod mesh;
pub(crate) mod mjcf;
pub(crate) mod motors;
pub(crate) mod spec;
pub(crate) mod truth;
pub(crate) mod vary;
pub(crate) mod world;
