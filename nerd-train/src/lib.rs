#![doc = include_str!("../README.md")]

/// Prints a line on standard error. A closed pipe is ignored, where `eprintln!` would panic.
#[macro_export]
macro_rules! tell {
    ($($text:tt)*) => { $crate::progress::tell(format_args!($($text)*)) };
}

pub mod bounds;
pub mod checkpoint;
pub mod comparison;
pub mod cost;
pub mod device;
pub mod difference;
pub mod error;
pub mod evaluate;
mod files;
pub mod learner;
pub mod measured;
pub mod onnx;
pub mod ppo;
mod prelude;
pub mod prepare;
pub mod progress;
pub mod provenance;
pub mod records;
pub mod replay;
pub mod run;
pub mod schedule;
pub mod settings;
pub mod shipped;
pub mod spec;
pub mod stats;
pub mod stop;
pub mod supply;
mod tensors;
pub mod trainer;
pub mod unroll;
pub mod verdict;
pub mod windows;
pub mod words;

pub use error::{Error, Result};
pub use {nerd_model, nerd_sim, nerd_tasks};
