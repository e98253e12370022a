//! Calibration: fits parameters of a robot, its contacts and its scene to measured trajectories ([`crate::log`]).
//!
//! A [`Subject`] is a robot under a solver, and a [`Parameter`] a named number with bounds. A [`Trial`] is a piece of a
//! measured trajectory. [`Subject::fit`] minimises the distance between trials and their open-loop rollouts.
//! [`Subject::profiles`] shows how sharply each parameter is determined.
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

mod bent;
mod fit;
mod own;
mod parameter;
mod subject;
mod trial;

pub use fit::{Fit, FitConfig, thinned};
pub use own::OwnFit;
pub use parameter::{CalibrateError, Parameter};
pub use subject::{Engine, Subject};
pub use trial::{Distance, Trial, distance, mean};
