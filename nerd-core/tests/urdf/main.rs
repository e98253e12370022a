//! What a URDF says, and what becomes of it.

#[path = "../common/mod.rs"]
mod common;

mod names;
mod reading;
mod refusals;
mod several;
mod welding;
