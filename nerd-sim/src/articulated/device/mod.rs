//! The articulated solver on a device.

mod back;
mod episode;
#[cfg(feature = "cuda")]
mod motion;
mod own;
mod program;
mod records;
#[cfg(feature = "cuda")]
mod roll;
#[cfg(feature = "cuda")]
mod rows;
#[cfg(feature = "cuda")]
mod scenes;
#[cfg(feature = "cuda")]
mod shared;
#[cfg(feature = "cuda")]
mod solver;
mod tables;
mod text;

#[cfg(feature = "cuda")]
pub use crate::solver::device::{Back, Held, Resident, Trail, failed};
pub use back::{back_program, goes_back};
pub use episode::{RANDOM, episode};
#[cfg(feature = "cuda")]
pub use motion::{BLOCK, Motion};
pub use own::Own;
pub use program::{Reach, Real, fault, functions, has_kernels, packed, program, record, surfaces};
pub use records::records;
#[cfg(feature = "cuda")]
pub use roll::{OnDevice, Roll};
#[cfg(feature = "cuda")]
pub use shared::SharedStates;
#[cfg(feature = "cuda")]
pub use solver::{CudaArticulated, Whole};
pub use text::{Text, number};
