//! The trait of solvers, which advance a batch by one frame, and the simulation that holds one.

mod check;
#[cfg(feature = "cuda")]
pub mod device;
pub(crate) mod parallel;
mod refusal;

pub(crate) use check::gone;
pub use check::{check, check_kin, commit};
#[cfg(feature = "cuda")]
pub(crate) use check::{finish, numbers, sound};
pub use refusal::{Capabilities, Fault, Slopes, StepError};

use crate::prelude::*;

/// Advances every environment of a batch by one control frame. It can be sent to another thread, and so can a [`Simulation`].
pub trait Solver: Send {
    /// One frame. `torques` are `[env][joint]` (N m or N), held over the frame and not limited by the URDF's effort. Angles of endless
    /// joints are returned wrapped to [-pi, pi).
    ///
    /// # Errors
    /// [`StepError::Environments`] if some environments could not be stepped and all others were; with any other error nothing was stepped.
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError>;

    /// The solver that this one wraps, if any: methods that are not overridden go to it.
    fn inner(&self) -> Option<&dyn Solver> {
        None
    }

    /// The same, mutable.
    fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
        None
    }

    /// Clears the memory of an environment.
    fn reset(&mut self, env: usize) {
        if let Some(inner) = self.inner_mut() {
            inner.reset(env);
        }
    }

    /// Memory of an environment, as numbers for [`Self::recall`]; empty if its next frame does not depend on earlier ones.
    ///
    /// # Errors
    /// [`StepError::Refused`] if memory cannot be read out.
    fn remembered(&self, env: usize) -> Result<Vec<f64>, StepError> {
        self.inner().map_or(Ok(Vec::new()), |inner| inner.remembered(env))
    }

    /// Replaces the memory of an environment by numbers that [`Self::remembered`] returned for it or for another one.
    ///
    /// # Errors
    /// If the numbers do not fit, or no batch with this environment has been stepped yet.
    fn recall(&mut self, env: usize, memory: &[f64]) -> Result<(), StepError> {
        if let Some(inner) = self.inner_mut() {
            return inner.recall(env, memory);
        }
        self.reset(env);
        Ok(())
    }

    /// Its capabilities beside stepping states.
    fn capabilities(&self) -> Capabilities {
        self.inner().map(|inner| inner.capabilities()).unwrap_or_default()
    }

    /// Vector-Jacobian products of the frame that [`Self::step`] would make from here: `rows` of them for every environment, from gradients
    /// `by_next` `[env][row][2 nv]` with respect to the next state, each in the tangent space of its own state ([`nerd_core::tangent`]).
    /// The batch and the solver's memory are not changed.
    ///
    /// # Errors
    /// [`StepError::Refused`] for a solver without gradients; else as [`Self::step`].
    fn back(&mut self, _batch: &Batch, _torques: &[f64], _rows: usize, _by_next: &[f64]) -> Result<Slopes, StepError> {
        Err(StepError::Refused("this solver has no slopes: take articulated, or a pure model whose network sees one frame".into()))
    }

    /// The frame to first order: [`Self::back`] with the rows of an identity. `states` holds the matrix A of every environment, `[2 nv][2
    /// nv]`, and `torques` its B, `[2 nv][joint]`. [`Slopes::forward`] multiplies them with a direction.
    fn linearise(&mut self, batch: &Batch, torques: &[f64]) -> Result<Slopes, StepError> {
        let size = 2 * batch.system.robot.nv();
        let identity: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k % (size + 1) == 0))).collect();
        self.back(batch, torques, size, &identity.repeat(batch.len()))
    }

    /// Itself as a solver that keeps a batch on a GPU, if it is one.
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
    /// The solver that advances them.
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

    /// Uses torques as servo targets from here on ([`Batch::servo`]), if the robot's position law acts inside a frame and the solver has
    /// drives; returns whether it does.
    pub fn serve(&mut self) -> bool {
        let law = self.batch.system.spec.control.is_some_and(|law| law.servo);
        self.batch.servo = law && self.batch.drives.is_empty() && self.solver.capabilities().drives;
        self.batch.servo
    }

    /// Puts one environment at `state`; clears the solver's memory of it.
    ///
    /// # Panics
    /// As [`Batch::reset`].
    pub fn reset(&mut self, env: usize, state: &[f64]) {
        self.batch.reset(env, state);
        self.solver.reset(env);
    }

    /// Makes environment `to` a copy of `from`, the solver's memory included: under the same torques both continue alike.
    ///
    /// # Errors
    /// As [`Solver::remembered`].
    ///
    /// # Panics
    /// If there is no such environment.
    pub fn fork(&mut self, from: usize, to: usize) -> Result<(), StepError> {
        self.batch.fork(from, to);
        let memory = self.solver.remembered(from)?;
        self.solver.recall(to, &memory)
    }
}
