#![doc = include_str!("../README.md")]

/// Standard `eprintln!` panics where nobody reads.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::progress::tell(format_args!($($text)*)) };
}

pub mod best;
pub mod bounds;
pub mod chain;
pub mod checkpoint;
pub mod choice;
#[cfg(feature = "report")]
pub mod cotrain;
pub mod device;
pub mod difference;
pub mod error;
pub mod evaluate;
#[cfg(feature = "report")]
pub mod experiments;
pub mod inspect;
pub mod learner;
pub mod metrics;
pub mod paper;
pub mod ppo;
pub mod prepare;
pub mod progress;
pub mod ranges;
pub mod ranks;
pub mod report;
pub mod run;
pub mod schedule;
pub mod sessions;
pub mod settings;
pub mod shipped;
pub mod stats;
pub mod supply;
pub mod trainer;
#[cfg(feature = "report")]
pub mod unroll;
pub mod windows;

pub use error::{Error, Result};
pub use {nerd_model, nerd_sim, nerd_tasks};
