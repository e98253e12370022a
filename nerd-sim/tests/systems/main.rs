//! Robots and their settings: built in, read, derived, varied, identified by hashes.

#[path = "../common/mod.rs"]
mod common;
mod derived;
#[cfg(feature = "meshes")]
mod fields;
mod grounds;
mod identity;
mod like;
#[cfg(feature = "meshes")]
mod meshes;
mod mjcf;
mod mjcf_reading;
mod mjcf_refusals;
mod range;
mod rig;
mod robots;
mod stance;
mod validate;
#[cfg(feature = "rapier")]
mod vary;
