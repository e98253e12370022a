//! Meshes: files within size limits, triangles, height fields, convex hulls.

#[cfg(feature = "meshes")]
pub(crate) mod file;
#[cfg(feature = "meshes")]
mod heights;
pub(crate) mod hull;
#[cfg(feature = "meshes")]
mod triangles;

#[cfg(feature = "meshes")]
pub(crate) use heights::heights;
pub(crate) use hull::{around, faces};
#[cfg(feature = "meshes")]
pub(crate) use triangles::{stl, triangles};
