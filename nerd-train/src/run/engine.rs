//! The learner of a network, by device.

use std::sync::Arc;

use super::data::Sets;
use super::memory;
use super::plan::Plan;
use crate::chain::ChainLearner;
#[cfg(feature = "cuda")]
use crate::chain::CudaChainLearner;
use crate::device::Device;
use crate::error::{Result, refuse};
#[cfg(feature = "burn")]
use crate::learner::BurnLearner;
#[cfg(feature = "cuda")]
use crate::learner::cuda::{CudaLearner, Precision};
use crate::learner::{CpuLearner, Learner, LearnerState};
use crate::ranks::Ranks;

/// What learns as one of `ranks`, at the state it goes on from.
pub(super) fn engine(plan: &Plan, ranks: &Arc<Ranks>, state: LearnerState, sets: Sets) -> Result<Box<dyn Learner>> {
    let learner = plan.learner;
    #[cfg(feature = "cuda")]
    let precision = if plan.config.f32 { Precision::F32 } else { Precision::Tf32 };
    Ok(match (plan.config.device, sets) {
        (Device::Cpu, Sets::Windows(sets)) => Box::new(CpuLearner::new(learner, state, sets)?.among(ranks)),
        #[cfg(feature = "burn")]
        (device @ (Device::Flex | Device::Wgpu), Sets::Windows(sets)) => {
            let made = BurnLearner::new(learner, state, sets, &device.burn()?)?.among(ranks);
            // A card wants all windows at once.
            Box::new(if device == Device::Wgpu { made.shards(learner.batch, 1) } else { made })
        }
        (Device::Cpu, Sets::Chain(course)) => {
            memory::unrolled(&plan.network, course.frames)?;
            Box::new(ChainLearner::new(plan.chain()?, learner, state, course)?.among(ranks))
        }
        #[cfg(feature = "cuda")]
        (Device::Cuda, Sets::Windows([train, validation])) => {
            Box::new(CudaLearner::new(ranks, learner, precision, state, [&train, &validation])?)
        }
        #[cfg(feature = "cuda")]
        (Device::Cuda, Sets::Chain(course)) => Box::new(CudaChainLearner::new(&plan.system, learner, precision, state, course, ranks)?),
        #[cfg(not(all(feature = "cuda", feature = "burn")))]
        (device, Sets::Windows(_)) => refuse!("this build has no --device {device}"),
        (device, Sets::Chain(_)) => refuse!("--device {device} trains no chains: use cpu or cuda"),
    })
}
