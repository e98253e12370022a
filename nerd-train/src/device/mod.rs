//! Devices that evaluate networks, and models as solvers on them.

#[cfg(feature = "cuda")]
mod card;

use nerd_model::solver::learned;

#[cfg(feature = "cuda")]
use crate::learner::cuda::Precision;
use crate::prelude::*;

/// The device that evaluates a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// The CPU.
    #[default]
    Cpu,
    /// An NVIDIA GPU (feature `cuda`). Matrix products are in f16 where a fused kernel evaluates the network.
    Cuda,
    /// An NVIDIA GPU, with matrix products in f32.
    CudaF32,
    /// The CPU through burn (feature `burn`).
    Flex,
    /// Any GPU with Vulkan, Metal or DirectX, through burn (feature `wgpu`).
    Wgpu,
}

impl std::fmt::Display for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(Self::WORDS[*self as usize])
    }
}

impl Device {
    /// Names on the command line and in serde, in the order of the variants.
    pub const WORDS: &[&str] = &["cpu", "cuda", "cuda-f32", "flex", "wgpu"];

    /// Refuses a device that this build or machine does not have.
    pub(crate) fn check(self) -> Result<()> {
        let (there, feature) = match self {
            Self::Cpu => return Ok(()),
            Self::Cuda | Self::CudaF32 => (cfg!(feature = "cuda"), "cuda"),
            Self::Flex => (cfg!(feature = "burn"), "burn"),
            Self::Wgpu => (cfg!(feature = "wgpu"), "wgpu"),
        };
        if !there {
            refuse!("--device {self} needs a build with `--features {feature}`");
        }
        #[cfg(feature = "burn")]
        if !self.is_cuda() {
            self.burn()?;
        }
        Ok(())
    }

    /// Whether the device is an NVIDIA GPU.
    pub fn is_cuda(self) -> bool {
        matches!(self, Self::Cuda | Self::CudaF32)
    }

    #[cfg(feature = "cuda")]
    fn precision(self) -> Precision {
        if self == Self::CudaF32 { Precision::F32 } else { Precision::F16 }
    }

    #[cfg(feature = "burn")]
    pub(crate) fn burn(self) -> Result<nerd_model::BurnDevice> {
        #[cfg(feature = "wgpu")]
        if self == Self::Wgpu {
            use burn::tensor::{DeviceKind, DeviceType};
            if nerd_model::BurnDevice::enumerate(DeviceType::Wgpu).is_empty() {
                refuse!(
                    "--device wgpu finds no card: install a driver of Vulkan, Metal or DirectX (Mesa's lavapipe is one for the CPU)"
                );
            }
            return Ok(nerd_model::BurnDevice::wgpu(DeviceKind::DefaultDevice));
        }
        Ok(nerd_model::BurnDevice::flex())
    }

    /// A network on this device, for up to `envs` environments.
    pub fn network(self, weights: &Weights, envs: usize) -> Result<Box<dyn Stream>> {
        self.check()?;
        match self {
            Self::Cpu => Ok(nerd_model::transformer::packed(weights)),
            Self::Cuda | Self::CudaF32 if weights.config.architecture == Architecture::Chain => {
                refuse!("--device {self} computes a chain in whole frames only")
            }
            #[cfg(feature = "cuda")]
            Self::Cuda | Self::CudaF32 => Ok(crate::learner::cuda::stream(weights, self.precision(), envs)?),
            #[cfg(feature = "burn")]
            Self::Flex | Self::Wgpu => {
                use nerd_model::transformer::{BurnForward, Windowed};
                Ok(Box::new(Windowed::new(BurnForward::new(weights, &self.burn()?), weights.config)))
            }
            #[cfg(not(all(feature = "cuda", feature = "burn")))]
            _ => refuse!("this build has no --device {self} for {envs} environments"),
        }
    }

    /// Loads a model folder as a solver of `system` for up to `envs` environments. If `truth` is given, the model must
    /// have learned it.
    pub fn neural(
        self,
        folder: &Path,
        system: &Arc<System>,
        truth: Option<&str>,
        envs: usize,
    ) -> Result<Box<dyn Solver>> {
        self.solver(Model::load(folder, system, truth)?, system, envs)
    }

    /// A model as a solver of `system` for up to `envs` environments. A GPU computes whole frames if the model has
    /// kernels, else only the network.
    pub fn solver(self, model: Model, system: &Arc<System>, envs: usize) -> Result<Box<dyn Solver>> {
        #[cfg(feature = "cuda")]
        if self.is_cuda() {
            let (own, of) = (model.clone(), system.clone());
            return card::frames(model, system, self.precision(), move || self.alone(own, &of, envs));
        }
        self.alone(model, system, envs)
    }

    /// A model with only its network on this device. A chain runs on the CPU as a whole.
    fn alone(self, model: Model, system: &Arc<System>, envs: usize) -> Result<Box<dyn Solver>> {
        if model.config.network.architecture == Architecture::Chain {
            return Ok(learned(model, system)?);
        }
        let network = self.network(&model.weights, envs)?;
        Ok(Box::new(Neural::new(model, network)))
    }
}

/// The articulated truth on a GPU, in f64.
pub(crate) fn truth_on_card(system: &System) -> Box<dyn Solver> {
    let config = nerd_sim::articulated::ArticulatedConfig::accurate(system);
    #[cfg(feature = "cuda")]
    return Box::new(nerd_sim::articulated::device::CudaArticulated::new(
        config,
        nerd_sim::articulated::device::Real::F64,
    ));
    // A build without `cuda` has refused the GPU before this call.
    #[cfg(not(feature = "cuda"))]
    Box::new(nerd_sim::articulated::Articulated::new(config))
}
