//! Names a solver, its settings and its device, as text or as [`SolverSpec`]. Command line, Python, charts, calibration
//! and results all name solvers in this way.
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

/// A solver with its settings.
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
    /// Method of time stepping.
    pub method: Method,
    /// Substeps per frame; `None` for the robot's own number.
    pub substeps: Option<usize>,
    /// Whether every substep is solved to convergence, for exact gradients.
    pub settled: bool,
    /// Device that computes the steps; a GPU computes in f32.
    pub device: Device,
}

/// Method of time stepping of [`ArticulatedSpec`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Implicit contact step; where there is nothing to touch, Runge-Kutta with four substeps. This is the truth of
    /// most models.
    #[default]
    Implicit,
    /// Symplectic Euler with explicit contact.
    Euler,
    /// Runge-Kutta where there is nothing to touch, else as [`Self::Implicit`].
    Rk4,
    /// The reference simulator's method, for robots NAME-paper.
    Paper,
}

/// Settings of rapier's multibodies. The default, 4 steps of 4 iterations in the root's axes, is the truth of models
/// ROBOT-rapier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RapierSpec {
    /// Steps per frame; each detects collisions anew.
    pub steps: usize,
    /// Solver iterations per step.
    pub iterations: usize,
    /// Whether steps use the world's axes, not the axes of a floating robot's root.
    pub world: bool,
}

/// A learned model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NeuralSpec {
    /// The model's folder; `None` for the shipped model of the robot and its truth.
    pub folder: Option<PathBuf>,
    /// Device that computes the network or the whole frame.
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
    /// Our articulated dynamics with this method and this number of substeps per frame.
    pub fn articulated(method: Method, substeps: usize) -> Self {
        ArticulatedSpec { method, substeps: Some(substeps), ..ArticulatedSpec::default() }.into()
    }

    /// Our articulated dynamics with the implicit method and this number of substeps per frame.
    pub fn implicit(substeps: usize) -> Self {
        Self::articulated(Method::Implicit, substeps)
    }

    /// rapier with this number of steps per frame, each of 4 iterations.
    pub fn rapier(steps: usize) -> Self {
        Self::Rapier(RapierSpec { steps, ..RapierSpec::default() })
    }

    /// The learned model in `folder`, on the CPU.
    pub fn neural(folder: impl Into<PathBuf>) -> Self {
        Self::Neural(NeuralSpec { folder: Some(folder.into()), device: Device::Cpu })
    }

    /// The same solver on the device `on`; rapier stays on the CPU.
    #[must_use]
    pub fn on(mut self, on: Device) -> Self {
        match &mut self {
            Self::Articulated(ArticulatedSpec { device, .. }) | Self::Neural(NeuralSpec { device, .. }) => *device = on,
            Self::Rapier(_) => {}
        }
        self
    }

    /// Device that computes the solver's steps.
    pub fn device(&self) -> Device {
        match self {
            Self::Articulated(ArticulatedSpec { device, .. }) | Self::Neural(NeuralSpec { device, .. }) => *device,
            Self::Rapier(_) => Device::Cpu,
        }
    }

    /// Whether the solver is a learned model, with or without a named folder.
    pub fn is_neural(&self) -> bool {
        matches!(self, Self::Neural(_))
    }

    /// Folder of the learned model, if the solver is one and its folder is named.
    pub fn folder(&self) -> Option<&Path> {
        if let Self::Neural(NeuralSpec { folder, .. }) = self { folder.as_deref() } else { None }
    }

    /// Fills in a missing model folder with that of the shipped model of this robot and its truth.
    ///
    /// # Errors
    /// If no such model comes with the project, or the named folder holds no model.
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

    /// Settings of the articulated solver; `None` for another solver.
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

    /// Whether, by their settings, both solvers move a robot alike in a scene.
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

    /// Substeps per frame; for rapier, steps times iterations. A learned model counts as 1.
    pub fn substeps(&self, system: &System) -> usize {
        match self {
            Self::Rapier(own) => own.steps.saturating_mul(own.iterations),
            _ => self.config(system).map_or(1, |config| config.substeps.max(config.contact_substeps)),
        }
    }

    /// The same solver with `times` as many substeps (rapier: steps). A learned model is unchanged.
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

    /// Number of substeps per frame that the solver's text gives. For rapier, these are its steps; with one step, its
    /// iterations if they are not 4.
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

    /// Name of the solver without its number of substeps, for a chart's legend.
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

    /// Makes the solver for up to `envs` environments of a robot.
    ///
    /// # Errors
    /// If this build lacks the solver's device, a model cannot be read, or the model is of another robot.
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
    /// These settings as a [`RapierConfig`].
    pub fn config(self) -> RapierConfig {
        RapierConfig {
            steps: self.steps,
            iterations: self.iterations,
            own_axes: !self.world,
            ..RapierConfig::default()
        }
    }
}
