//! Where networks are computed, and models as solvers there.

#[cfg(feature = "cuda")]
mod card;

#[cfg(feature = "cuda")]
pub use card::resident;
use nerd_model::pick::learned;

#[cfg(feature = "cuda")]
use crate::learner::cuda::Precision;
use crate::prelude::*;

/// Where networks are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// The CPU.
    #[default]
    Cpu,
    /// An NVIDIA GPU (feature `cuda`); where one kernel computes a network whole, its products are in f16.
    Cuda,
    /// The same, all in f32.
    CudaF32,
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

    /// Whether it is an NVIDIA GPU.
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
                refuse!("--device wgpu finds no card: install a driver of Vulkan, Metal or DirectX (Mesa's lavapipe is one for the CPU)");
            }
            return Ok(nerd_model::BurnDevice::wgpu(DeviceKind::DefaultDevice));
        }
        Ok(nerd_model::BurnDevice::flex())
    }

    /// A network on this device, for `envs` environments.
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

    /// Loads a folder's model as a solver of `system` for `envs` environments; the model must have learned `truth`, if given.
    pub fn neural(self, folder: &Path, system: &Arc<System>, truth: Option<&str>, envs: usize) -> Result<Box<dyn Solver>> {
        self.solver(Model::load(folder, system, truth)?, system, envs)
    }

    /// A model as a solver of `system` for `envs` environments: whole frames are computed on a GPU where they can be, or else the network.
    pub fn solver(self, model: Model, system: &Arc<System>, envs: usize) -> Result<Box<dyn Solver>> {
        #[cfg(feature = "cuda")]
        if self.is_cuda() {
            let (own, of) = (model.clone(), system.clone());
            return card::frames(model, system, self.precision(), move || self.alone(own, &of, envs));
        }
        self.alone(model, system, envs)
    }

    /// A model whose network alone is on this device; of a chain that is on the CPU, too.
    fn alone(self, model: Model, system: &Arc<System>, envs: usize) -> Result<Box<dyn Solver>> {
        if model.config.network.architecture == Architecture::Chain {
            return Ok(learned(model, system)?);
        }
        let network = self.network(&model.weights, envs)?;
        Ok(Box::new(Neural::new(model, network)))
    }
}

/// The articulated truth on a GPU, in 64 bits.
pub(crate) fn truth_on_card(system: &System) -> Box<dyn Solver> {
    let config = nerd_sim::articulated::ArticulatedConfig::accurate(system);
    #[cfg(feature = "cuda")]
    return Box::new(nerd_sim::articulated::device::CudaArticulated::new(config, nerd_sim::articulated::device::Real::F64));
    // What needs a card was refused before.
    #[cfg(not(feature = "cuda"))]
    Box::new(nerd_sim::articulated::Articulated::new(config))
}
