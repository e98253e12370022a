//! Chooses the learner of a run by device and data.

use super::data::Sets;
use super::*;
#[cfg(feature = "burn")]
use crate::learner::BurnLearner;
use crate::learner::CpuLearner;
#[cfg(feature = "cuda")]
use crate::learner::cuda::{CudaLearner, Precision};
#[cfg(feature = "cuda")]
use crate::unroll::CudaUnrollLearner;
use crate::unroll::{Body, UnrollLearner};

/// The learner of a run, resumed at `state`.
pub(super) fn engine(plan: &Plan, state: LearnerState, sets: Sets) -> Result<Box<dyn Learner>> {
    let learner = plan.learner;
    Ok(match (plan.config.device, sets) {
        (Device::Cpu, Sets::Windows(sets)) => Box::new(CpuLearner::new(learner, state, sets)?),
        #[cfg(feature = "burn")]
        (device @ (Device::Flex | Device::Wgpu), Sets::Windows(sets)) => {
            let made = BurnLearner::new(learner, state, sets, &device.burn()?)?;
            // A GPU computes all windows of a batch in one shard.
            Box::new(if device == Device::Wgpu { made.shards(learner.batch, 1) } else { made })
        }
        (Device::Cpu, Sets::Cable(course)) => unrolled(plan, state, *course)?,
        (_, Sets::Robot(course)) => unrolled(plan, state, *course)?,
        #[cfg(feature = "cuda")]
        (_, Sets::Cable(course)) => {
            Box::new(CudaUnrollLearner::new(&plan.system, learner, precision(plan), state, *course)?)
        }
        #[cfg(feature = "cuda")]
        (Device::Cuda | Device::CudaF32, Sets::Windows([train, validation])) => {
            Box::new(CudaLearner::new(learner, precision(plan), state, [&train, &validation])?)
        }
        #[cfg(not(all(feature = "cuda", feature = "burn")))]
        (device, _) => refuse!("this build has no --device {device}"),
    })
}

#[cfg(feature = "cuda")]
fn precision(plan: &Plan) -> Precision {
    if plan.config.f32 { Precision::F32 } else { Precision::Tf32 }
}

/// The learner that trains through rollouts on the CPU.
fn unrolled<B: Body + 'static>(plan: &Plan, state: LearnerState, course: Course<B>) -> Result<Box<dyn Learner>> {
    memory::unrolled(&plan.network, course.frames)?;
    Ok(Box::new(UnrollLearner::new(plan.learner, state, course)?))
}
