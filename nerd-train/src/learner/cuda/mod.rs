//! The fused CUDA engine: the Transformer's forward and backward pass, clip, Adam and moving average written out by
//! hand, captured as one CUDA graph and replayed per update.
//!
//! Matrix products go through cuBLAS, everything else through `kernels.cu`, compiled by NVRTC when the engine
//! starts. Driver, cuBLAS and NVRTC are loaded at run time; without them the constructors return
//! [`LearnError::Device`]. All sums have a fixed order and cuBLAS a fixed workspace, so a
//! run that is stopped and taken up again from its state gives the same bits as an unbroken one on the same device.

mod forward;
mod layout;
mod muon;
mod network;
mod neural;
mod step;
mod stream;
mod trainer;

use nerd_model::transformer::{Positions, Stream, Weights, Windowed};

pub use forward::CudaForward;
pub use nerd_cuda::Precision;
pub use neural::{CudaNeural, Network as Learned, neural};
pub use stream::CudaStream;
pub use trainer::CudaLearner;

use super::LearnError;

/// The engine of a network for at most `envs` environments: remembering if its positions allow it, or else recomputing
/// windows.
///
/// # Errors
/// Of the engine.
pub fn stream(weights: &Weights, precision: Precision, envs: usize) -> Result<Box<dyn Stream>, LearnError> {
    Ok(match weights.config.positions {
        Positions::Table => Box::new(Windowed::new(CudaForward::new(weights, precision, envs)?, weights.config)),
        Positions::Rotary => Box::new(CudaStream::new(weights, precision, envs)?),
    })
}
