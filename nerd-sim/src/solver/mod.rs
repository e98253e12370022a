//! The [`Solver`] trait, which advances a batch by one frame, and the simulation that holds a solver.

mod check;
#[cfg(feature = "cuda")]
pub mod device;
pub(crate) mod parallel;
mod refusal;

pub(crate) use check::gone;
pub use check::{check, check_kin, commit};
#[cfg(feature = "cuda")]
pub(crate) use check::{finish, numbers, sound};
pub use refusal::{Capabilities, Fault, Gradients, StepError};

use crate::prelude::*;

/// Advances every environment of a batch by one frame. Solvers and [`Simulation`]s can be sent to other threads.
pub trait Solver: Send {
    /// Steps one frame. `torques` are `[env][joint]` (N m or N), held constant over the frame and not limited by the
    /// URDF's effort. Angles of endless joints are returned wrapped to [-pi, pi).
    ///
    /// # Errors
    /// [`StepError::Environments`] if some environments could not be stepped; all others were. With any other error
    /// nothing was stepped.
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError>;

    /// The wrapped solver, if any; methods that are not overridden delegate to it.
    fn inner(&self) -> Option<&dyn Solver> {
        None
    }

    /// The wrapped solver, mutable.
    fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
        None
    }

    /// Clears what the solver remembers of an environment's earlier frames.
    fn reset(&mut self, env: usize) {
        if let Some(inner) = self.inner_mut() {
            inner.reset(env);
        }
    }

    /// Capabilities in addition to stepping states.
    fn capabilities(&self) -> Capabilities {
        self.inner().map(|inner| inner.capabilities()).unwrap_or_default()
    }

    /// Vector-Jacobian products of the frame that [`Self::step`] would make: `rows` for every environment. `grad_next`
    /// `[env][row][2 nv]` are gradients with respect to the next state. Gradients with respect to a state are in its
    /// tangent space ([`nerd_core::tangent`]). Batch and solver memory stay unchanged.
    ///
    /// # Errors
    /// [`StepError::Refused`] for a solver without gradients; else the errors of [`Self::step`].
    fn vjp(
        &mut self,
        _batch: &Batch,
        _torques: &[f64],
        _rows: usize,
        _grad_next: &[f64],
    ) -> Result<Gradients, StepError> {
        Err(StepError::Refused(
            "this solver has no gradients: take articulated, or a pure model whose network sees one frame".into(),
        ))
    }

    /// Linearisation of the frame: [`Self::vjp`] with the rows of an identity. `states` holds the matrix A of every
    /// environment, `[2 nv][2 nv]`, and `torques` the matrix B, `[2 nv][joint]`. [`Gradients::forward`] multiplies A
    /// and B by a direction.
    fn linearise(&mut self, batch: &Batch, torques: &[f64]) -> Result<Gradients, StepError> {
        let size = 2 * batch.system.robot.nv();
        let identity: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k % (size + 1) == 0))).collect();
        self.vjp(batch, torques, size, &identity.repeat(batch.len()))
    }

    /// This solver as a [`device::Resident`], if it can keep a batch on a GPU.
    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        None
    }
}

/// Delegates the other methods of a [`Solver`] to its field `solver`.
macro_rules! around {
    () => {
        fn inner(&self) -> Option<&dyn Solver> {
            Some(&self.solver)
        }

        fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
            Some(&mut self.solver)
        }
    };
}
pub(crate) use around;

impl Solver for Box<dyn Solver + '_> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        (**self).step(batch, torques)
    }

    fn inner(&self) -> Option<&dyn Solver> {
        Some(&**self)
    }

    fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
        Some(&mut **self)
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        (**self).vjp(batch, torques, rows, grad_next)
    }

    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        (**self).resident()
    }
}

/// A batch with its solver; assign `solver` to swap it mid-run.
pub struct Simulation {
    /// States and scenes.
    pub batch: Batch,
    /// The solver that advances the batch.
    pub solver: Box<dyn Solver>,
}

impl Simulation {
    /// Combines a batch and a solver.
    pub fn new(batch: Batch, solver: impl Solver + 'static) -> Self {
        Self { batch, solver: Box::new(solver) }
    }

    /// Steps one frame; see [`Solver::step`].
    pub fn step(&mut self, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(&mut self.batch, torques)
    }

    /// Treats torques as servo commands ([`Batch::servo`]) from now on. Returns false, without effect, unless the
    /// robot's position law acts inside the frame and the solver has drives.
    pub fn serve(&mut self) -> bool {
        let law = self.batch.system.spec.control.is_some_and(|law| law.servo);
        self.batch.servo = law && self.batch.drives.is_empty() && self.solver.capabilities().drives;
        self.batch.servo
    }

    /// Sets the state of an environment and clears the solver's memory of this environment.
    ///
    /// # Panics
    /// Under the same conditions as [`Batch::reset`].
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        self.batch.reset(env, state);
        self.solver.reset(env);
    }
}
