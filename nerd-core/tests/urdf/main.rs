//! Reading and refusing URDFs.

#[path = "../common/mod.rs"]
mod common;

mod bodies;
mod names;
mod reading;
mod refusals;
mod several;
mod welding;
