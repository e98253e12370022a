//! Where networks are computed.

use std::path::Path;
use std::sync::Arc;

use nerd_model::folder::Model;
use nerd_model::neural::Neural;
#[cfg(feature = "cuda")]
use nerd_model::pick::Setting;
use nerd_model::pick::learned;
use nerd_model::transformer::{Architecture, Stream, Weights};
#[cfg(not(feature = "cuda"))]
use nerd_sim::articulated::Articulated;
use nerd_sim::articulated::ArticulatedConfig;
#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::{CudaArticulated, Real, Resident, Roll};
#[cfg(feature = "cuda")]
use nerd_sim::batch::Batch;
use nerd_sim::solver::Solver;
#[cfg(feature = "cuda")]
use nerd_sim::solver::{Capabilities, StepError};
use nerd_sim::system::System;
use serde::{Deserialize, Serialize};

#[cfg(feature = "cuda")]
use crate::error::Error;
use crate::error::Result;
#[cfg(feature = "cuda")]
use crate::learner::cuda::{self, Precision};

/// Where networks are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// The CPU.
    #[default]
    Cpu,
    /// An NVIDIA GPU (feature `cuda`).
    Cuda,
    /// The CPU through burn (feature `burn`).
    Flex,
    /// Any card that Vulkan, Metal or DirectX drives, through burn (feature `wgpu`).
    Wgpu,
}

impl std::fmt::Display for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(Self::WORDS[*self as usize])
    }
}

impl Device {
    /// Their names, as serde has them.
    pub const WORDS: &[&str] = &["cpu", "cuda", "flex", "wgpu"];

    /// A network on this device, for so many environments.
    ///
    /// # Errors
    /// If this build or machine has no such device, or it computes no such network.
    pub fn network(self, weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
        match self {
            Self::Cpu => Ok(nerd_model::transformer::packed(weights)),
            Self::Cuda => on_cuda(weights, envs),
            Self::Flex | Self::Wgpu => on_burn(self, weights),
        }
    }

    /// The model of a folder as a solver of `system` for so many environments; one of `truth`, if that is named.
    ///
    /// # Errors
    /// Those of [`Model::load`] and [`Self::network`].
    pub fn neural(self, folder: &Path, system: &Arc<System>, truth: Option<&str>, envs: usize) -> Result<Box<dyn Solver>> {
        self.solver(Model::load(folder, system, truth)?, system, envs, |network| network)
    }

    /// A model as a solver of `system` for so many environments: whole frames are computed on a GPU where they can be, or else the network,
    /// around which `wrap` may put something.
    ///
    /// # Errors
    /// Those of [`Self::network`].
    pub fn solver(
        self,
        model: Model,
        system: &Arc<System>,
        envs: usize,
        wrap: impl FnOnce(Box<dyn Stream>) -> Box<dyn Stream> + Send + 'static,
    ) -> Result<Box<dyn Solver>> {
        #[cfg(feature = "cuda")]
        if self == Self::Cuda {
            match cuda::whole(model.clone(), system, Real::F32, Precision::F32) {
                Ok(whole) => {
                    let (system, chain) = (system.clone(), model.config.network.architecture == Architecture::Chain);
                    let alone = move || self.alone(model, &system, envs, wrap);
                    let rest = if chain { "all is on the CPU" } else { "the network alone is on the card" };
                    return Ok(Box::new(Willing { whole, stepped: false, alone: Some(Box::new(alone)), rest, instead: None }));
                }
                Err(why) => eprintln!("{why}"),
            }
        }
        self.alone(model, system, envs, wrap)
    }

    /// A model whose network alone is on this device; of a chain that is on the CPU, too.
    fn alone(
        self,
        model: Model,
        system: &Arc<System>,
        envs: usize,
        wrap: impl FnOnce(Box<dyn Stream>) -> Box<dyn Stream>,
    ) -> Result<Box<dyn Solver>> {
        if model.config.network.architecture == Architecture::Chain {
            return Ok(learned(model, system)?);
        }
        let network = self.network(&model.weights, envs)?;
        Ok(Box::new(Neural::new(model, system, wrap(network))))
    }
}

/// Makes a solver when it is needed.
#[cfg(feature = "cuda")]
type Alone = Box<dyn FnOnce() -> Result<Box<dyn Solver>> + Send>;

/// Whole frames on the card, until a batch asks for what has no kernels (a scene with hills, say): from there on the network alone is there, or
/// of a chain nothing.
#[cfg(feature = "cuda")]
struct Willing {
    whole: Box<dyn Roll>,
    /// Whether whole frames went well.
    stepped: bool,
    /// How to go on, until it is needed.
    alone: Option<Alone>,
    /// What that is.
    rest: &'static str,
    instead: Option<Box<dyn Solver>>,
}

#[cfg(feature = "cuda")]
impl Solver for Willing {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> std::result::Result<(), StepError> {
        if let Some(instead) = &mut self.instead {
            return instead.step(batch, torques);
        }
        let why = match self.whole.step(batch, torques) {
            Err(StepError::Refused(why)) => why,
            // A robot too large for the card is known when its kernels are made.
            Err(StepError::Solver(why)) if !self.stepped => why,
            done => {
                self.stepped = true;
                return done;
            }
        };
        // What asks too much of the solver on the card may do so of every one; then that one says it.
        let Some(alone) = self.alone.take() else { return Err(StepError::Refused(why)) };
        let mut instead = alone().map_err(|e| StepError::Solver(format!("{why}; without kernels: {e}")))?;
        let done = instead.step(batch, torques);
        if !matches!(done, Err(StepError::Refused(_))) {
            eprintln!("from now on {}: {why}", self.rest);
        }
        self.instead = Some(instead);
        done
    }

    fn reset(&mut self, env: usize) {
        match &mut self.instead {
            Some(instead) => instead.reset(env),
            None => self.whole.reset(env),
        }
    }

    fn capabilities(&self) -> Capabilities {
        self.instead.as_ref().map_or_else(|| self.whole.capabilities(), |instead| instead.capabilities())
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        if self.instead.is_some() { None } else { self.whole.resident() }
    }
}

/// A solver at one setting whose batch stays on a GPU.
///
/// # Errors
/// A solver that has no kernels; those of [`Model::load`].
#[cfg(feature = "cuda")]
pub fn resident(setting: &Setting, system: &Arc<System>, real: Real, precision: Precision) -> Result<Box<dyn Roll>> {
    if let Setting::Neural(folder) = setting {
        let whole = cuda::whole(Model::load(folder, system, None)?, system, real, precision);
        return whole.map_err(|why| Error::Refused(format!("{}: {why}", folder.display())));
    }
    let config = setting.articulated(system).ok_or_else(|| Error::Refused(format!("{setting} has no kernels; step it on the CPU")))?;
    Ok(Box::new(CudaArticulated::new(config, real)))
}

/// The articulated truth on a GPU, in 64 bits.
pub(crate) fn truth_on_card(system: &System) -> Box<dyn Solver> {
    let config = ArticulatedConfig::accurate(system);
    #[cfg(feature = "cuda")]
    return Box::new(CudaArticulated::new(config, Real::F64));
    // What needs a card was refused before.
    #[cfg(not(feature = "cuda"))]
    Box::new(Articulated::new(config))
}

#[cfg(feature = "burn")]
fn on_burn(device: Device, weights: &Weights) -> Result<Box<dyn Stream>> {
    use nerd_model::transformer::{BurnForward, Windowed};
    Ok(Box::new(Windowed::new(BurnForward::new(weights, &device.burn()?), weights.config)))
}

#[cfg(not(feature = "burn"))]
fn on_burn(device: Device, _weights: &Weights) -> Result<Box<dyn Stream>> {
    device.no_burn()
}

impl Device {
    /// That of burn.
    #[cfg(feature = "burn")]
    pub(crate) fn burn(self) -> Result<nerd_model::BurnDevice> {
        #[cfg(not(feature = "wgpu"))]
        if self == Self::Wgpu {
            return self.no_burn();
        }
        #[cfg(feature = "wgpu")]
        if self == Self::Wgpu {
            use burn::tensor::{DeviceKind, DeviceType};
            if nerd_model::BurnDevice::enumerate(DeviceType::Wgpu).is_empty() {
                crate::error::refuse!(
                    "--device wgpu finds no card: install a driver of Vulkan, Metal or DirectX (Mesa's lavapipe is one for the CPU)"
                );
            }
            return Ok(nerd_model::BurnDevice::wgpu(DeviceKind::DefaultDevice));
        }
        Ok(nerd_model::BurnDevice::flex())
    }

    #[cfg(not(feature = "wgpu"))]
    pub(crate) fn no_burn<T>(self) -> Result<T> {
        crate::error::refuse!("--device {self} needs a build with `--features {}`", if self == Self::Wgpu { "wgpu" } else { "burn" })
    }
}

#[cfg(feature = "cuda")]
fn on_cuda(weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
    if weights.config.architecture == Architecture::Chain {
        crate::error::refuse!("--device cuda answers for a chain in whole frames alone");
    }
    Ok(cuda::stream(weights, Precision::F32, envs)?)
}

#[cfg(not(feature = "cuda"))]
fn on_cuda(_weights: &Weights, _envs: usize) -> Result<Box<dyn Stream>> {
    crate::error::refuse!("--device cuda needs a build with `--features cuda`")
}
