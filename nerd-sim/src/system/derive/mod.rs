//! Settings derived from a URDF's numbers.

mod base;
#[cfg(feature = "meshes")]
mod collada;
#[cfg(feature = "meshes")]
mod file;
#[cfg(feature = "meshes")]
mod gltf;
mod guess;
mod hull;
mod limits;
#[cfg(feature = "meshes")]
mod meshes;
mod plain;
mod spread;
mod srdf;
mod stance;
#[cfg(feature = "meshes")]
mod wheel;

pub(crate) use guess::{derived, floats, rotor, stiffness};
#[cfg(feature = "meshes")]
pub(crate) use hull::{faces, few};
pub(crate) use limits::stiffen;
#[cfg(feature = "meshes")]
pub(crate) use meshes::{touch, vertices};
pub(crate) use plain::{between, listed, plain, rounded};
