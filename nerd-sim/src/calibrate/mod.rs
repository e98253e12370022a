//! Calibration: parameters of a robot, its contacts and its scene, fitted to measured trajectories ([`crate::log`]).
//!
//! A [`Subject`] is a robot under a solver, a [`Parameter`] a number of it that has a name and bounds, a [`Trial`] a piece of a
//! measured trajectory. [`Subject::fit`] makes open-loop rollouts of the trials as near to them as the parameters allow, and
//! [`Subject::profiles`] says how sharply each is determined.
//!
//! ```no_run
//! use nerd_sim::{calibrate::*, log::Log, prelude::*};
//! let log = Log::read("tosses/cube.log.toml".as_ref(), None)?;
//! let engine = Engine::Articulated(ArticulatedConfig::implicit(4, Friction::Coulomb));
//! let subject = Subject::new(&log.system, &log.scene, engine)?;
//! let parameters = ["com.z", "friction"].map(|name| Parameter::named(&log.system, name)).into_iter().collect::<Result<Vec<_>, _>>()?;
//! let fit = subject.fit(&parameters, &log.trials(80, 4), FitConfig::default(), &mut |_, _| ())?;
//! println!("{:?} {:?}", fit.values, fit.after);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod fit;
mod parameter;
mod saved;
mod subject;
mod trial;

pub use fit::{Fit, FitConfig, objective, thinned};
pub use parameter::Parameter;
pub use saved::Saved;
pub use subject::{Engine, Subject};
pub use trial::{Distance, Trial, distance, mean};

use crate::solver::StepError;
use crate::system::SystemError;

/// Why nothing can be fitted; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// No such parameter.
    #[error("no parameter `{0}`: known are {1}")]
    Parameter(String, String),
    /// Not one of this engine's.
    #[error("parameter `{0}` means nothing to this solver; leave it out")]
    Engine(String),
    /// A scene that there is not.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A step of the solver.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A parameter without anything to change.
    #[error("parameter `{0}` has nothing to act on: no gravity, no mass, or no plane of the scene's own; leave it out")]
    Nothing(String),
    /// A file that does not say what is needed.
    #[error("{}: {}", .0.display(), .1)]
    File(std::path::PathBuf, String),
    /// Nothing to fit to.
    #[error("no trials to fit to")]
    Empty,
}
