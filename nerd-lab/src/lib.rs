#![doc = include_str!("../README.md")]
// Nobody outside this repository calls it, and every error is one line for whoever gave the command.
#![allow(missing_docs, clippy::missing_errors_doc)]

#[macro_use(tell)]
extern crate nerd_train;

pub mod campaign;
pub mod choice;
pub mod circles;
pub mod error;
pub mod experiments;
pub mod live;
pub mod mujoco;
pub mod page;
pub mod paper;
mod prelude;
pub mod report;
mod roll;
pub mod survey;
