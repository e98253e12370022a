//! The articulated solver on a device.

mod back;
mod episode;
mod program;
#[cfg(feature = "cuda")]
mod roll;
#[cfg(feature = "cuda")]
mod rows;
#[cfg(feature = "cuda")]
mod scenes;
#[cfg(feature = "cuda")]
mod solver;

#[cfg(feature = "cuda")]
pub use crate::solver::device::{Back, Held, Resident, Trail, failed};
pub use back::{back_program, goes_back};
pub use episode::{RANDOM, episode};
pub use program::{Reach, Real, fault, functions, packed, program, record, surfaces};
#[cfg(feature = "cuda")]
pub use roll::{BLOCK, Motion, OnDevice, Roll};
#[cfg(feature = "cuda")]
pub use solver::{CudaArticulated, Whole};
