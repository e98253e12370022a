//! The articulated solver on a device.

mod episode;
#[cfg(feature = "cuda")]
mod held;
mod program;
#[cfg(feature = "cuda")]
mod roll;
#[cfg(feature = "cuda")]
mod solver;
#[cfg(feature = "cuda")]
mod torques;

pub use episode::{RANDOM, episode};
#[cfg(feature = "cuda")]
pub use held::Held;
pub use program::{Reach, Real, fault, functions, packed, program, record, surfaces};
#[cfg(feature = "cuda")]
pub use roll::{BLOCK, Motion, OnDevice, Resident, Roll, failed};
#[cfg(feature = "cuda")]
pub use solver::{CudaArticulated, Whole};
