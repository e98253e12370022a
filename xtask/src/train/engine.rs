//! What trains and evaluates networks, by device.

use std::sync::Arc;

use anyhow::{Result, bail};
use nerd_model::BurnDevice;
use nerd_model::transformer::{Architecture, Stream, TransformerConfig, Weights};
use nerd_train::learner::{BurnLearner, CpuLearner, Learner, LearnerConfig, LearnerState};
use nerd_train::prepare::Prepared;

use super::TrainArgs;
use crate::common::Device;

/// A network on a device, for so many environments.
pub fn network(weights: &Weights, device: Device, envs: usize) -> Result<Box<dyn Stream>> {
    match device {
        Device::Cpu => Ok(nerd_model::network::on_cpu(weights)),
        Device::Cuda => on_cuda(weights, envs),
    }
}

#[cfg(feature = "cuda")]
fn on_cuda(weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
    transformer_only(&weights.config)?;
    Ok(nerd_train::learner::cuda::stream(weights, nerd_train::learner::cuda::Precision::F32, envs)?)
}

#[cfg(not(feature = "cuda"))]
fn on_cuda(_weights: &Weights, _envs: usize) -> Result<Box<dyn Stream>> {
    bail!("--device cuda needs a build with `--features cuda`")
}

/// The fused engine is one network's.
#[cfg(feature = "cuda")]
fn transformer_only(network: &TransformerConfig) -> Result<()> {
    match network.architecture {
        Architecture::Transformer => Ok(()),
        other => bail!("--device cuda computes Transformers, no {other:?}; leave it out"),
    }
}

/// What computes a run and how exactly, in words; refused where this program has no such engine, or none for the network.
pub fn arithmetic(args: &TrainArgs, network: &TransformerConfig) -> Result<String> {
    match args.device {
        Device::Cpu => Ok("f32 on the CPU".into()),
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            transformer_only(network)?;
            Ok(if args.f32 { "f32 on CUDA" } else { "tf32 on CUDA" }.into())
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => bail!("--device cuda needs a build with `--features cuda`, of {} as of any network", network.embedding),
    }
}

/// What learns, at the state it goes on from.
pub fn engine(
    args: &TrainArgs,
    config: LearnerConfig,
    state: LearnerState,
    data: Prepared,
    validation: nerd_train::windows::Windows,
) -> Result<Box<dyn Learner>> {
    match args.device {
        Device::Cpu => {
            let (windows, validation) = (Arc::new(data.windows), Arc::new(validation));
            Ok(match state.weights.config.architecture {
                Architecture::Transformer => Box::new(CpuLearner::new(config, state, windows, validation)?),
                _ => Box::new(BurnLearner::new(config, state, windows, validation, &BurnDevice::flex())?),
            })
        }
        #[cfg(feature = "cuda")]
        Device::Cuda => {
            use nerd_train::learner::cuda::{CudaLearner, Precision};
            transformer_only(&state.weights.config)?;
            let precision = if args.f32 { Precision::F32 } else { Precision::Tf32 };
            Ok(Box::new(CudaLearner::new(config, precision, state, &data.windows, &validation)?))
        }
        #[cfg(not(feature = "cuda"))]
        Device::Cuda => bail!("--device cuda needs a build with `--features cuda`"),
    }
}
