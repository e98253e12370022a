//! Robots and what is said of them: built in, read, derived, varied, known by their hashes.

mod derived;
mod identity;
mod like;
#[cfg(feature = "meshes")]
mod meshes;
mod range;
mod robots;
mod validate;
#[cfg(feature = "rapier")]
mod vary;
