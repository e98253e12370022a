//! Picks a solver by a named setting, as in charts and results.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::prelude::*;
use crate::{chain::ChainSolver, folder::ModelError, transformer::Architecture};

/// A solver at one setting. [`Setting::series`] and `Display` give its name in every table and picture:
///
/// ```
/// # use nerd_model::pick::Setting;
/// assert_eq!(Setting::Implicit(4).to_string(), "articulated implicit x4");
/// assert_eq!(Setting::Neural("models/ant".into()).to_string(), "NeRD of models/ant");
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Setting {
    /// `articulated`, Runge-Kutta with this number of substeps; without contact.
    Rk4(usize),
    /// `articulated`, symplectic Euler, explicit contact.
    Euler(usize),
    /// `articulated` with the implicit contact step.
    Implicit(usize),
    /// `articulated` with the robot's own substeps, the truth of the shipped models.
    Accurate,
    /// `articulated` at the reference simulator's settings, the truth of models of robots `NAME-paper`.
    Paper,
    /// rapier with this number of iterations inside one outer step.
    Rapier(usize),
    /// rapier with this number of outer steps, collisions found again in each, at its default of 4 iterations.
    RapierSteps(usize),
    /// The same along the axes of a floating robot's root, as the truth of models named `ROBOT-rapier`.
    RapierOwn(usize),
    /// A learned model, by its folder.
    Neural(PathBuf),
}

impl Setting {
    /// The same solver at any number of substeps, as in a legend.
    pub fn series(&self) -> &'static str {
        match self {
            Self::Rk4(_) => "articulated RK4",
            Self::Euler(_) => "articulated symplectic Euler",
            Self::Implicit(_) => "articulated implicit",
            Self::Accurate => "articulated, preset accurate",
            Self::Paper => "articulated, preset paper",
            Self::Rapier(_) => "rapier, iterations of 1 step",
            Self::RapierSteps(_) => "rapier, steps of 4 iterations",
            Self::RapierOwn(_) => "rapier, steps of 4 iterations, own axes",
            Self::Neural(_) => "NeRD",
        }
    }

    /// Substeps a frame.
    pub fn substeps(&self) -> Option<usize> {
        match self {
            Self::Rk4(n) | Self::Euler(n) | Self::Implicit(n) | Self::Rapier(n) | Self::RapierSteps(n) | Self::RapierOwn(n) => Some(*n),
            Self::Accurate | Self::Paper | Self::Neural(_) => None,
        }
    }

    /// Settings of `articulated`, if the setting is of this solver.
    pub fn articulated(&self, system: &System) -> Option<ArticulatedConfig> {
        let friction = Friction::Coulomb;
        match self {
            Self::Rk4(n) => Some(ArticulatedConfig { substeps: *n, ..ArticulatedConfig::converged(friction) }),
            Self::Euler(n) => Some(ArticulatedConfig::explicit(*n, friction)),
            Self::Implicit(n) => Some(ArticulatedConfig::implicit(*n, friction)),
            Self::Accurate => Some(ArticulatedConfig::accurate(system)),
            Self::Paper => Some(ArticulatedConfig::paper(system, friction)),
            Self::Rapier(_) | Self::RapierSteps(_) | Self::RapierOwn(_) | Self::Neural(_) => None,
        }
    }

    /// The solver, a learned one on the CPU.
    ///
    /// # Errors
    /// If a model folder cannot be read or holds another robot's model, or rapier is chosen and not built in.
    pub fn solver(&self, system: &Arc<System>) -> Result<Box<dyn Solver>, PickError> {
        match (self, self.articulated(system)) {
            (_, Some(config)) => Ok(Box::new(Articulated::new(config))),
            (Self::Neural(folder), None) => Ok(learned(Model::load(folder, system, None)?, system)?),
            #[cfg(feature = "rapier")]
            (Self::Rapier(n), None) => Ok(Box::new(Rapier::new(RapierConfig::substeps(*n)))),
            #[cfg(feature = "rapier")]
            (Self::RapierSteps(n), None) => Ok(Box::new(Rapier::new(RapierConfig { steps: *n, ..RapierConfig::default() }))),
            #[cfg(feature = "rapier")]
            (Self::RapierOwn(n), None) => Ok(Box::new(Rapier::new(RapierConfig { steps: *n, ..Truth::rapier() }))),
            (_, None) => Err(PickError::Refused("this build has no rapier: enable the feature `rapier` of nerd-model".into())),
        }
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rk4(n) | Self::Euler(n) | Self::Implicit(n) => write!(f, "{} x{n}", self.series()),
            Self::Accurate => f.write_str("articulated accurate"),
            Self::Paper => f.write_str("articulated paper"),
            Self::Rapier(n) => write!(f, "rapier 1x{n}"),
            Self::RapierSteps(n) => write!(f, "rapier {n}x4"),
            Self::RapierOwn(n) => write!(f, "rapier {n}x4, own axes"),
            Self::Neural(folder) => write!(f, "NeRD of {}", folder.display()),
        }
    }
}

/// A model as a solver on the CPU: [`ChainSolver`] for a chain, [`Neural`] for any other robot.
///
/// # Errors
/// If the model is of a chain and the robot is another one.
pub fn learned(model: Model, system: &Arc<System>) -> Result<Box<dyn Solver>, ModelError> {
    Ok(match model.config.network.architecture {
        Architecture::Chain => Box::new(ChainSolver::new(&model.weights, &model.normalizer, system)?),
        _ => Box::new(Neural::on_cpu(model)),
    })
}

/// The setting of a truth.
impl From<Truth> for Setting {
    fn from(truth: Truth) -> Self {
        match truth {
            #[cfg(feature = "rapier")]
            Truth::Rapier => Self::RapierOwn(Truth::rapier().steps),
            Truth::Paper => Self::Paper,
            _ => Self::Accurate,
        }
    }
}

/// Why no solver was made; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PickError {
    /// A model that cannot be loaded.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A solver that this build does not have.
    #[error("{0}")]
    Refused(String),
}
