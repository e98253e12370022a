//! Reading URDFs: content and results.

#[path = "../common/mod.rs"]
mod common;

mod bodies;
mod names;
mod reading;
mod refusals;
mod several;
mod welding;
