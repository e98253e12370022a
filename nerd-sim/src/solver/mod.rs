//! The trait of solvers, which advance a batch by one frame, and the simulation that holds one.

mod capabilities;
mod check;
#[cfg(feature = "cuda")]
pub mod device;
mod error;
pub(crate) mod parallel;
mod simulation;

pub use capabilities::Capabilities;
pub(crate) use check::gone;
pub use check::{check, commit};
#[cfg(feature = "cuda")]
pub(crate) use check::{finish, sound};
pub use error::{Fault, StepError};
pub use simulation::Simulation;

use crate::batch::Batch;

/// Advances every environment of a batch by one control frame. It can be sent to another thread, and so can a [`Simulation`].
pub trait Solver: Send {
    /// One frame. `torques` are `[env][joint]` (N m or N), held over the frame. Angles of endless joints come back
    /// wrapped to [-pi, pi).
    ///
    /// # Errors
    /// [`StepError::Environments`] if some environments could not be stepped, all others were; else nothing was.
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError>;

    /// Clears what is remembered of an environment.
    fn reset(&mut self, _env: usize) {}

    /// What it can do beside stepping states.
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    /// Itself as what keeps a batch on a graphics card, if that is what it does.
    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        None
    }
}

impl<S: Solver + ?Sized> Solver for Box<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        (**self).step(batch, torques)
    }

    fn reset(&mut self, env: usize) {
        (**self).reset(env);
    }

    fn capabilities(&self) -> Capabilities {
        (**self).capabilities()
    }

    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        (**self).resident()
    }
}
