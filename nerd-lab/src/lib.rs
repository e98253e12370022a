#![doc = include_str!("../README.md")]

/// Standard `eprintln!` panics where nobody reads.
macro_rules! eprintln {
    ($($text:tt)*) => { nerd_train::progress::tell(format_args!($($text)*)) };
}

pub mod campaign;
pub mod choice;
pub mod cotrain;
pub mod error;
pub mod experiments;
pub mod inspect;
pub mod mujoco;
pub mod paper;
pub mod report;
pub mod survey;
