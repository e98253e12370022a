//! Robots and what is said of them: built in, read, derived, varied, known by their hashes.

#[path = "../common/mod.rs"]
mod common;
mod derived;
mod identity;
mod like;
#[cfg(feature = "meshes")]
mod meshes;
mod mjcf;
mod range;
mod rig;
mod robots;
mod validate;
#[cfg(feature = "rapier")]
mod vary;
