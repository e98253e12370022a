//! The articulated solver on a device.

mod program;
#[cfg(feature = "cuda")]
mod solver;

pub use program::{Reach, Real, fault, functions, packed, program, record};
#[cfg(feature = "cuda")]
pub use solver::CudaArticulated;
