//! The CUDA engine: any network's program, forward and back, with clip, Adam, Muon and moving average, captured as one CUDA graph and
//! replayed per update.
//!
//! Matrix products go through cuBLAS, everything else through `kernels/*.cu`, which NVRTC compiles with the program's shapes when the
//! engine starts. Driver, cuBLAS and NVRTC are loaded at run time; without them the constructors return
//! [`LearnError::Device`]. All sums have a fixed order and cuBLAS a fixed workspace, so a
//! run that is stopped and taken up again from its state gives the same bits as an unbroken one on the same device.

mod attention;
mod backward;
mod cell;
mod chain;
mod forward;
mod muon;
mod network;
mod neural;
mod optimiser;
mod plan;
mod program;
mod source;
mod step;
mod stream;
mod trainer;
mod unroll;

use std::sync::Arc;

use nerd_model::folder::Model;
use nerd_model::transformer::{Architecture, Stream, Weights, Windowed};
use nerd_sim::articulated::device::{Real, Roll};
use nerd_sim::system::System;

pub use chain::{Along, CudaChain, chain};
pub use forward::CudaForward;
pub use nerd_cuda::Precision;
pub(crate) use network::Network;
pub use neural::{CudaNeural, Network as Learned, neural};
pub(crate) use plan::Plan;
pub use program::CudaProgram;
pub use stream::CudaStream;
pub use trainer::CudaLearner;
pub use unroll::CudaUnroll;

use super::LearnError;

/// The engine of a network for at most `envs` environments: frame by frame if it can be, or else recomputing windows.
///
/// # Errors
/// Of the engine.
pub fn stream(weights: &Weights, precision: Precision, envs: usize) -> Result<Box<dyn Stream>, LearnError> {
    Ok(match Plan::stream(&weights.config) {
        Ok(_) => Box::new(CudaStream::new(weights, precision, envs)?),
        Err(_) => Box::new(Windowed::new(CudaForward::new(weights, precision, envs)?, weights.config)),
    })
}

/// A model as a solver whose whole frames are on the device: of a chain [`CudaChain`], of any other robot [`CudaNeural`]. What is not the
/// network of a chain has 64 bits, whatever is asked for.
///
/// # Errors
/// What of the model has no kernel.
pub fn whole(model: Model, system: &Arc<System>, real: Real, precision: Precision) -> Result<Box<dyn Roll>, String> {
    Ok(match model.config.network.architecture {
        Architecture::Chain => Box::new(chain(model, system, precision)?),
        _ => Box::new(neural(model, system, real, precision)?),
    })
}
