#![doc = include_str!("../README.md")]
// No public API: nothing outside this repository calls it, and every error is one line for the user.
#![allow(missing_docs, clippy::missing_errors_doc)]

#[macro_use(tell)]
extern crate nerd_train;

pub mod campaign;
pub mod circles;
pub mod experiments;
pub mod mujoco;
pub mod page;
mod prelude;
pub mod report;
