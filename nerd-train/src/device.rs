//! Where networks are computed.

use std::path::Path;
use std::sync::Arc;

use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_model::transformer::{Stream, Weights};
use nerd_sim::system::System;
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// Where networks are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// The CPU.
    #[default]
    Cpu,
    /// An NVIDIA GPU (feature `cuda`).
    Cuda,
}

impl std::fmt::Display for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::Cpu { "cpu" } else { "cuda" })
    }
}

impl Device {
    /// A network on this device, for so many environments.
    ///
    /// # Errors
    /// If this build or machine has no such device, or it computes no such network.
    pub fn network(self, weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
        match self {
            Self::Cpu => Ok(nerd_model::network::on_cpu(weights)),
            Self::Cuda => on_cuda(weights, envs),
        }
    }

    /// The model of a folder as a solver of `system` for so many environments; one of `truth`, if that is named.
    ///
    /// # Errors
    /// Those of [`Model::load`] and [`Self::network`].
    pub fn neural(self, folder: &Path, system: &Arc<System>, truth: Option<&str>, envs: usize) -> Result<Neural> {
        let model = Model::load(folder, system, truth)?;
        let network = self.network(&model.weights, envs)?;
        Ok(Neural::new(model, system, network))
    }
}

#[cfg(feature = "cuda")]
fn on_cuda(weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
    transformer_only(&weights.config)?;
    Ok(crate::learner::cuda::stream(weights, crate::learner::cuda::Precision::F32, envs)?)
}

#[cfg(not(feature = "cuda"))]
fn on_cuda(_weights: &Weights, _envs: usize) -> Result<Box<dyn Stream>> {
    crate::error::refuse!("--device cuda needs a build with `--features cuda`")
}

/// The fused engine is one network's.
#[cfg(feature = "cuda")]
pub(crate) fn transformer_only(network: &nerd_model::transformer::TransformerConfig) -> Result<()> {
    match network.architecture {
        nerd_model::transformer::Architecture::Transformer => Ok(()),
        other => crate::error::refuse!("--device cuda computes Transformers, no {other:?}; leave it out"),
    }
}
