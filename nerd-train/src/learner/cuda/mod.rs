//! The CUDA engine: forward and backward passes of any program, gradient clipping, Adam, Muon and moving average. One
//! CUDA graph, captured once, replays every update.
//!
//! Matrix products go through cuBLAS, everything else through `kernels/*.cu`, compiled by NVRTC with the program's
//! shapes when the engine starts. Driver, cuBLAS and NVRTC are loaded at run time; without them the constructors return
//! [`LearnError::Device`]. All sums have a fixed order and cuBLAS a fixed workspace. So a resumed run gives the same
//! bits as an unbroken one on the same device.

mod attention;
mod backward;
mod forward;
mod gradients;
mod lowering;
mod muon;
mod network;
mod optimiser;
mod passes;
mod plan;
mod program;
mod resident;
mod stream;
mod trainer;

use nerd_cuda::{Arg, Buffer, Device, DeviceError, DeviceResult, Event, Lane, Replay, args};
use nerd_model::program::{Op, Program, Slot, Step, Weight};
use nerd_model::transformer::Windowed;

use super::mismatch;
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

/// The engine of a network for at most `envs` environments. It takes one token per frame if the network allows, or else
/// whole windows.
pub fn stream(weights: &Weights, precision: Precision, envs: usize) -> LearnResult<Box<dyn Stream>> {
    Ok(match Plan::stream(&weights.config) {
        Ok(_) => Box::new(CudaStream::new(weights, precision, envs)?),
        Err(_) => Box::new(Windowed::new(CudaForward::new(weights, precision, envs)?, weights.config)),
    })
}
