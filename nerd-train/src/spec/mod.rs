//! Which solver at which settings on which device: text to value and back, the one way in which command line, Python,
//! charts, calibration and results name a solver.
//!
//! ```
//! use nerd_train::spec::SolverSpec;
//! for text in ["articulated", "articulated(substeps=4)", "articulated(method=euler, substeps=16)", "rapier(steps=1)", "neural(models/ant, cuda)"] {
//!     assert_eq!(text.parse::<SolverSpec>()?.to_string(), text);
//! }
//! # Ok::<(), nerd_train::Error>(())
//! ```

#[cfg(feature = "cuda")]
mod resident;
mod text;

#[cfg(feature = "cuda")]
pub use resident::resident;

#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::{CudaArticulated, Real, has_kernels};
use nerd_sim::rig::rigged;

use crate::{device::Device, prelude::*, shipped};

/// A solver at its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum SolverSpec {
    /// Our articulated dynamics.
    Articulated(ArticulatedSpec),
    /// rapier's multibodies.
    Rapier(RapierSpec),
    /// A learned model.
    Neural(NeuralSpec),
}

/// Settings of our articulated dynamics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ArticulatedSpec {
    /// Time stepping.
    pub method: Method,
    /// Substeps per frame; the robot's own where none are given.
    pub substeps: Option<usize>,
    /// Solves every substep to convergence, for exact gradients.
    pub settled: bool,
    /// Where it computes; a GPU computes in f32.
    pub device: Device,
}

/// Time stepping of [`ArticulatedSpec`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Implicit contact step; Runge-Kutta with four substeps where there is nothing to touch. The truth of most models.
    #[default]
    Implicit,
    /// Symplectic Euler with explicit contact.
    Euler,
    /// Runge-Kutta where there is nothing to touch, else as [`Self::Implicit`].
    Rk4,
    /// The reference simulator's, for robots NAME-paper.
    Paper,
}

/// Settings of rapier's multibodies: by default 4 steps of 4 iterations in the root's axes, the truth of models
/// ROBOT-rapier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RapierSpec {
    /// Collisions are found anew in each.
    pub steps: usize,
    /// Solver iterations per step.
    pub iterations: usize,
    /// Steps in the world's axes, not in the axes of a floating robot's root.
    pub world: bool,
}

/// A learned model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NeuralSpec {
    /// Its folder; the one that comes with the project for the robot and its truth where none is given.
    pub folder: Option<PathBuf>,
    /// Where the network or the whole frame is computed.
    pub device: Device,
}

/// Relative change of drags below which `settled` substeps end, and the largest number of solves.
const SETTLED: (f64, usize) = (1e-13, 30_000);

const USUAL: RapierSpec = RapierSpec { steps: 4, iterations: 4, world: false };

impl Default for RapierSpec {
    fn default() -> Self {
        USUAL
    }
}

impl Default for SolverSpec {
    fn default() -> Self {
        Self::Articulated(ArticulatedSpec::default())
    }
}

impl From<Truth> for SolverSpec {
    fn from(truth: Truth) -> Self {
        match truth {
            Truth::Rapier => Self::Rapier(RapierSpec::default()),
            Truth::Paper => ArticulatedSpec { method: Method::Paper, ..ArticulatedSpec::default() }.into(),
            _ => Self::default(),
        }
    }
}

impl From<ArticulatedSpec> for SolverSpec {
    fn from(own: ArticulatedSpec) -> Self {
        Self::Articulated(own)
    }
}

impl SolverSpec {
    /// Our dynamics by a method with a number of substeps.
    pub fn articulated(method: Method, substeps: usize) -> Self {
        ArticulatedSpec { method, substeps: Some(substeps), ..ArticulatedSpec::default() }.into()
    }

    /// The same by the implicit method.
    pub fn implicit(substeps: usize) -> Self {
        Self::articulated(Method::Implicit, substeps)
    }

    /// rapier with a number of steps of 4 iterations.
    pub fn rapier(steps: usize) -> Self {
        Self::Rapier(RapierSpec { steps, ..RapierSpec::default() })
    }

    /// A model's folder, on the CPU.
    pub fn neural(folder: impl Into<PathBuf>) -> Self {
        Self::Neural(NeuralSpec { folder: Some(folder.into()), device: Device::Cpu })
    }

    /// The same on a device.
    #[must_use]
    pub fn on(mut self, on: Device) -> Self {
        match &mut self {
            Self::Articulated(ArticulatedSpec { device, .. }) | Self::Neural(NeuralSpec { device, .. }) => *device = on,
            Self::Rapier(_) => {}
        }
        self
    }

    /// Where it computes.
    pub fn device(&self) -> Device {
        match self {
            Self::Articulated(ArticulatedSpec { device, .. }) | Self::Neural(NeuralSpec { device, .. }) => *device,
            Self::Rapier(_) => Device::Cpu,
        }
    }

    /// Whether it is a model, its folder named or not.
    pub fn is_neural(&self) -> bool {
        matches!(self, Self::Neural(_))
    }

    /// The model's folder, if it is one.
    pub fn folder(&self) -> Option<&Path> {
        if let Self::Neural(NeuralSpec { folder, .. }) = self { folder.as_deref() } else { None }
    }

    /// With the folder filled in: the shipped model of this robot and its truth.
    ///
    /// # Errors
    /// If no such model comes with the project, or there is none in the folder.
    pub fn found(self, system: &System) -> Result<Self> {
        let Self::Neural(NeuralSpec { folder, device }) = &self else { return Ok(self) };
        if let Some(folder) = folder {
            match folder.join("config.json").exists() {
                true => return Ok(self),
                false => {
                    refuse!("{}: no model is there; name the folder of one, as in neural(models/ant)", folder.display())
                }
            }
        }
        let device = *device;
        let folder = shipped::model(system.spec.truth, &system.name);
        if !folder.join("config.json").exists() {
            refuse!(
                "no model of `{}` comes with the project ({}): train one, and name its folder (--model)",
                system.name,
                folder.display()
            );
        }
        Ok(Self::neural(folder).on(device))
    }

    /// Its settings, if it is `articulated`.
    pub fn config(&self, system: &System) -> Option<ArticulatedConfig> {
        let Self::Articulated(ArticulatedSpec { method, substeps, .. }) = self else { return None };
        let n = substeps.unwrap_or(system.spec.substeps);
        Some(match method {
            Method::Implicit => ArticulatedConfig::implicit(n, Friction::Coulomb),
            Method::Euler => ArticulatedConfig::explicit(n, Friction::Coulomb),
            Method::Rk4 => ArticulatedConfig { substeps: n, ..ArticulatedConfig::implicit(n, Friction::Coulomb) },
            Method::Paper => {
                let own = ArticulatedConfig::paper(system, Friction::Coulomb);
                ArticulatedConfig { substeps: n, contact_substeps: n, ..own }
            }
        })
    }

    /// Whether both move a robot alike in a scene, by their settings.
    pub fn moves_as(&self, other: &Self, system: &System, scene: &Scene) -> bool {
        let contact = system.held() || !scene.colliders.is_empty() && !system.robot.contact_points.is_empty();
        match (self, other) {
            (Self::Articulated(own), Self::Articulated(their))
                if (own.settled, own.device) == (their.settled, their.device) =>
            {
                self.config(system)
                    .zip(other.config(system))
                    .is_some_and(|(ours, theirs)| ours.moves_as(&theirs, contact))
            }
            _ => self == other,
        }
    }

    /// Substeps per frame, as far as they are known before a model is read.
    pub fn substeps(&self, system: &System) -> usize {
        match self {
            Self::Rapier(own) => own.steps.saturating_mul(own.iterations),
            _ => self.config(system).map_or(1, |config| config.substeps.max(config.contact_substeps)),
        }
    }

    /// With `times` as many substeps (rapier: steps). A model is unchanged.
    #[must_use]
    pub fn refined(&self, times: usize, system: &System) -> Self {
        let mut finer = self.clone();
        match &mut finer {
            Self::Articulated(own) => {
                own.substeps =
                    Some(times * own.substeps.unwrap_or(system.spec.substeps)).filter(|_| times > 1).or(own.substeps)
            }
            Self::Rapier(own) => own.steps *= times,
            Self::Neural(_) => {}
        }
        finer
    }

    /// Substeps as named in the text. Of rapier: steps, or with one step its iterations where they are not 4.
    pub fn asked(&self) -> Option<usize> {
        match self {
            Self::Articulated(own) => own.substeps,
            Self::Rapier(RapierSpec { steps: 1, iterations, .. }) if *iterations != USUAL.iterations => {
                Some(*iterations)
            }
            Self::Rapier(own) => Some(own.steps),
            Self::Neural(_) => None,
        }
    }

    /// The same solver at any number of substeps, as in a legend.
    pub fn series(&self) -> &'static str {
        match self {
            Self::Articulated(ArticulatedSpec { method, substeps, .. }) => match (method, substeps) {
                (Method::Implicit, Some(_)) => "articulated, implicit",
                (Method::Implicit, None) => "articulated",
                (Method::Euler, _) => "articulated, symplectic Euler",
                (Method::Rk4, _) => "articulated, RK4",
                (Method::Paper, _) => "articulated, the paper's method",
            },
            Self::Rapier(RapierSpec { world: true, .. }) => "rapier, world axes",
            Self::Rapier(RapierSpec { iterations, .. }) if *iterations == USUAL.iterations => {
                "rapier, steps of 4 iterations"
            }
            Self::Rapier(RapierSpec { steps: 1, .. }) => "rapier, iterations of 1 step",
            Self::Rapier(_) => "rapier",
            Self::Neural(_) => "NeRD",
        }
    }

    /// The solver for `envs` environments of a robot.
    ///
    /// # Errors
    /// If this build has no such device, or a model cannot be read or is another robot's.
    pub fn solver(&self, system: &Arc<System>, envs: usize) -> Result<Box<dyn Solver>> {
        self.device().check()?;
        match (self, self.config(system)) {
            (Self::Articulated(own), Some(config)) => own.solver(config, system),
            (Self::Rapier(own), _) => Ok(rigged(Box::new(Rapier::new(own.config())), system)),
            _ => {
                let found = self.clone().found(system)?;
                self.device().neural(found.folder().unwrap_or(Path::new("")), system, None, envs)
            }
        }
    }
}

impl ArticulatedSpec {
    fn solver(self, config: ArticulatedConfig, system: &System) -> Result<Box<dyn Solver>> {
        if self.method == Method::Paper {
            Truth::Paper.check(&system.robot, system.spec.self_collision).map_err(|e| format!("method=paper: {e}"))?;
        }
        match self.device {
            Device::Cpu => {
                let solver = Articulated::new(config);
                Ok(rigged(Box::new(if self.settled { solver.settling(SETTLED.0, SETTLED.1) } else { solver }), system))
            }
            #[cfg(feature = "cuda")]
            Device::Cuda | Device::CudaF32 if !self.settled => {
                has_kernels(&config).map_err(|why| format!("{}: {why}", SolverSpec::from(self)))?;
                Ok(Box::new(CudaArticulated::new(config, Real::F32)))
            }
            other => refuse!("{} is not on {other}; take cpu, or cuda without `settled`", SolverSpec::from(self)),
        }
    }
}

impl RapierSpec {
    /// rapier's own settings.
    pub fn config(self) -> RapierConfig {
        RapierConfig {
            steps: self.steps,
            iterations: self.iterations,
            own_axes: !self.world,
            ..RapierConfig::default()
        }
    }
}
