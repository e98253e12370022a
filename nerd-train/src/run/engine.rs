//! What trains a network, by device.

use std::sync::Arc;

use nerd_model::chain::OUTPUTS;
use nerd_sim::system::System;

use super::RunConfig;
use crate::chain::Motions;
use crate::device::Device;
use crate::error::Result;
use crate::learner::{CpuLearner, Learner, LearnerConfig, LearnerState};
use crate::ranks::Ranks;
use crate::windows::Windows;

/// What computes a run and how exactly, in words; refused where this program has no such engine.
pub fn arithmetic(config: &RunConfig) -> Result<String> {
    match config.device {
        Device::Cpu => Ok("f32 on the CPU".into()),
        #[cfg(feature = "burn")]
        Device::Flex | Device::Wgpu => config.device.burn().map(|_| format!("f32 through burn on {}", config.device)),
        #[cfg(not(feature = "burn"))]
        Device::Flex | Device::Wgpu => config.device.no_burn(),
        #[cfg(feature = "cuda")]
        Device::Cuda => Ok(if config.f32 { "f32 on CUDA" } else { "tf32 on CUDA" }.into()),
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => no_cuda(),
    }
}

/// What learns as one of `ranks` on data and validation, at the state it goes on from; on CUDA in tf32, or in f32 if `exact`.
#[cfg_attr(not(feature = "cuda"), expect(unused_variables, reason = "only CUDA knows tf32"))]
pub fn engine(
    device: Device,
    exact: bool,
    learner: LearnerConfig,
    state: LearnerState,
    [training, validation]: [Arc<Windows>; 2],
    ranks: &Arc<Ranks>,
) -> Result<Box<dyn Learner>> {
    match device {
        Device::Cpu => Ok(Box::new(CpuLearner::new(learner, state, training, validation)?.among(ranks))),
        #[cfg(feature = "burn")]
        Device::Flex | Device::Wgpu => {
            let batch = learner.batch;
            let made = crate::learner::BurnLearner::new(learner, state, training, validation, &device.burn()?)?.among(ranks);
            // A card wants all windows at once.
            Ok(Box::new(if device == Device::Wgpu { made.shards(batch, 1) } else { made }))
        }
        #[cfg(not(feature = "burn"))]
        Device::Flex | Device::Wgpu => device.no_burn(),
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            use crate::learner::cuda::{CudaLearner, Precision};
            let precision = if exact { Precision::F32 } else { Precision::Tf32 };
            Ok(Box::new(CudaLearner::among(ranks, learner, precision, state, &training, &validation)?))
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => no_cuda(),
    }
}

/// What learns of a chain, on CUDA: from motions and validated on others, through so many frames. `scales` are those of [`crate::chain::scales`].
///
/// # Errors
/// Those of `CudaUnroll::new`; a build without CUDA.
#[cfg_attr(not(feature = "cuda"), expect(unused_variables, reason = "without CUDA it is refused"))]
pub fn unrolled(
    (system, ranks): (&Arc<System>, &Arc<Ranks>),
    (learner, exact): (LearnerConfig, bool),
    state: LearnerState,
    sets: [Arc<Motions>; 2],
    scales: ([f64; OUTPUTS], f64),
    frames: usize,
) -> Result<Box<dyn Learner>> {
    #[cfg(feature = "cuda")]
    {
        use crate::learner::cuda::{CudaUnroll, Precision};
        let precision = if exact { Precision::F32 } else { Precision::Tf32 };
        Ok(Box::new(CudaUnroll::new(system, (learner, precision), state, sets, scales, frames, ranks)?))
    }
    #[cfg(not(feature = "cuda"))]
    no_cuda()
}

#[cfg(not(feature = "cuda"))]
fn no_cuda<T>() -> Result<T> {
    crate::error::refuse!("--device cuda needs a build with `--features cuda`")
}
