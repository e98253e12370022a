#![doc = include_str!("../README.md")]
// No public API: only this repository's programs call it, and every error is one line for the user.
#![allow(missing_docs, clippy::missing_errors_doc)]

#[macro_use(tell)]
extern crate nerd_train;

/// Prints a line to standard output; `println!` would panic on a closed pipe.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}

pub mod call;
pub mod commands;
pub mod conduct;
pub mod describe;
pub mod error;
pub mod experiments;
pub mod live;
pub mod motions;
pub mod mujoco;
pub mod options;
pub mod out;
pub mod panics;
pub mod paper;
mod prelude;
mod refusals;
mod renamed;
pub mod report;
pub mod roll;
mod signals;
mod solvers;
pub mod survey;
pub mod verbs;
