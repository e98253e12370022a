//! Derives the settings of a robot from the numbers in its file.

mod base;
#[cfg(feature = "meshes")]
mod collada;
#[cfg(feature = "meshes")]
mod gltf;
mod ground;
mod guess;
mod leg;
mod limbs;
mod limits;
#[cfg(feature = "meshes")]
mod meshes;
mod motor;
mod plain;
mod spread;
mod srdf;
mod stance;
mod touch;
mod wheel;
mod xml;

pub(crate) use ground::Ground;
pub(crate) use guess::{derived, floats, stiffness};
pub(crate) use limits::stiffen;
#[cfg(feature = "meshes")]
pub(crate) use meshes::vertices;
pub(crate) use motor::rotor;
pub(crate) use plain::{between, listed, plain, rounded};
pub(crate) use touch::touch;

/// Without the feature `meshes` no mesh is read.
#[cfg(not(feature = "meshes"))]
pub(crate) fn vertices(
    _: &str,
    _: &nerd_core::prelude::Vector3<f64>,
    _: &std::path::Path,
) -> Result<Vec<nerd_core::prelude::Vector3<f64>>, String> {
    Err("is not read without the feature `meshes`".into())
}
