//! The CUDA engine: any network's program, forward and backward, with clip, Adam, Muon and moving average, captured as one CUDA graph and
//! replayed for every update.
//!
//! Matrix products go through cuBLAS, everything else through `kernels/*.cu`, which NVRTC compiles with the program's shapes when the
//! engine starts. Driver, cuBLAS and NVRTC are loaded at run time; without them the constructors return [`LearnError::Device`]. All sums
//! have a fixed order and cuBLAS a fixed workspace, so a resumed run gives the same bits as an unbroken one on the same device.

mod attention;
mod backward;
mod forward;
mod lowering;
mod muon;
mod network;
mod optimiser;
mod passes;
mod plan;
mod program;
mod resident;
mod slopes;
mod stream;
mod trainer;

use nerd_cuda::Arg::{self, Double, Float, Int, Long, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Event, Lane, Replay};
use nerd_model::program::{Op, Program, Slot, Step, Weight};
use nerd_model::transformer::Windowed;

use crate::prelude::*;
use attention::Attention;
use plan::Part;

pub use forward::CudaForward;
pub use nerd_cuda::Precision;
pub(crate) use network::{Network, kernels};
pub(crate) use optimiser::Optimiser;
pub(crate) use plan::Plan;
pub use program::CudaProgram;
pub use resident::{Frames, resident};
pub use stream::CudaStream;
pub use trainer::CudaLearner;

/// The engine of a network for at most `envs` environments: frame by frame if it can be, or else recomputing windows.
pub fn stream(weights: &Weights, precision: Precision, envs: usize) -> Result<Box<dyn Stream>, LearnError> {
    Ok(match Plan::stream(&weights.config) {
        Ok(_) => Box::new(CudaStream::new(weights, precision, envs)?),
        Err(_) => Box::new(Windowed::new(CudaForward::new(weights, precision, envs)?, weights.config)),
    })
}
