//! Robots read from MJCF, MuJoCo's own text.
//!
//! What is read becomes a URDF and keys of a specification, so that both kinds of file are one kind of robot from there on. mjcf-rs reads
//! elements and their defaults. A joint's coordinate is MuJoCo's own, `ref` included; a link's frame has the axes of its body and its origin
//! at the body's last joint. Equalities of joints hold exactly ([`nerd_core::robot::Mimic`]), limits and contacts by our laws.

mod description;
mod drives;
mod inertia;
mod keys;
mod read;
mod text;
mod tree;
mod words;

pub(crate) use description::Description;
pub use text::is_mjcf;
pub(crate) use text::{escape, numbers};
