//! The trait of solvers, which advance a batch by one frame, and the simulation that holds one.

mod check;
#[cfg(feature = "cuda")]
pub mod device;
pub(crate) mod parallel;
mod refusal;
mod slopes;

pub(crate) use check::gone;
pub use check::{check, commit};
#[cfg(feature = "cuda")]
pub(crate) use check::{finish, sound};
pub use refusal::{Capabilities, Fault, StepError};
pub use slopes::Slopes;

use crate::batch::Batch;

/// Advances every environment of a batch by one control frame. It can be sent to another thread, and so can a [`Simulation`].
pub trait Solver: Send {
    /// One frame. `torques` are `[env][joint]` (N m or N), held over the frame and not limited by the URDF's effort. Angles of endless
    /// joints come back wrapped to [-pi, pi).
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

    /// Vector-Jacobian products of the frame that [`Self::step`] would make from here: `rows` of them for every environment, of gradients
    /// `by_next` `[env][row][2 nv]` by the next state, each in the tangent space of its own state ([`nerd_core::tangent`]). The batch
    /// and what the solver remembers stay as they are. With the rows of an identity the result is the frame's linearisation.
    ///
    /// # Errors
    /// [`StepError::Refused`] of a solver without slopes; else as [`Self::step`].
    fn back(&mut self, _batch: &Batch, _torques: &[f64], _rows: usize, _by_next: &[f64]) -> Result<Slopes, StepError> {
        Err(StepError::Refused("this solver has no slopes: take articulated, or a pure model whose network sees one frame".into()))
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

    fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        (**self).back(batch, torques, rows, by_next)
    }

    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        (**self).resident()
    }
}

/// A batch with the solver that advances it; assign `solver` to swap it mid-run.
pub struct Simulation {
    /// States and scenes.
    pub batch: Batch,
    /// What advances them.
    pub solver: Box<dyn Solver>,
}

impl Simulation {
    /// From a batch and a solver.
    pub fn new(batch: Batch, solver: impl Solver + 'static) -> Self {
        Self { batch, solver: Box::new(solver) }
    }

    /// One frame; see [`Solver::step`].
    pub fn step(&mut self, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(&mut self.batch, torques)
    }

    /// Puts one environment at `state`; the solver forgets its past.
    ///
    /// # Panics
    /// As [`Batch::reset`].
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        self.batch.reset(env, state);
        self.solver.reset(env);
    }
}
