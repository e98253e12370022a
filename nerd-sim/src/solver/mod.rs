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
    /// joints come back wrapped to [-pi, pi).
    ///
    /// # Errors
    /// [`StepError::Environments`] if some environments could not be stepped, all others were; else nothing was.
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError>;

    /// The solver that this one is put around, if it is around one: what it does not say of itself, that one says.
    fn inner(&self) -> Option<&dyn Solver> {
        None
    }

    /// The same, to be changed.
    fn inner_mut(&mut self) -> Option<&mut dyn Solver> {
        None
    }

    /// Clears what is remembered of an environment.
    fn reset(&mut self, env: usize) {
        if let Some(inner) = self.inner_mut() {
            inner.reset(env);
        }
    }

    /// What it remembers of an environment, as numbers for [`Self::recall`]; empty if its next frame depends on none before.
    ///
    /// # Errors
    /// [`StepError::Refused`] where memory cannot be told.
    fn remembered(&self, env: usize) -> Result<Vec<f64>, StepError> {
        self.inner().map_or(Ok(Vec::new()), |inner| inner.remembered(env))
    }

    /// Remembers of an environment what was [`Self::remembered`] of it, or of another one, in place of what it does now.
    ///
    /// # Errors
    /// If those are not such numbers, or no batch with this environment has been stepped yet.
    fn recall(&mut self, env: usize, memory: &[f64]) -> Result<(), StepError> {
        if let Some(inner) = self.inner_mut() {
            return inner.recall(env, memory);
        }
        self.reset(env);
        Ok(())
    }

    /// What it can do beside stepping states.
    fn capabilities(&self) -> Capabilities {
        self.inner().map(|inner| inner.capabilities()).unwrap_or_default()
    }

    /// Vector-Jacobian products of the frame that [`Self::step`] would make from here: `rows` of them for every environment, of gradients
    /// `by_next` `[env][row][2 nv]` by the next state, each in the tangent space of its own state ([`nerd_core::tangent`]). The batch
    /// and what the solver remembers stay as they are.
    ///
    /// # Errors
    /// [`StepError::Refused`] of a solver without slopes; else as [`Self::step`].
    fn back(&mut self, _batch: &Batch, _torques: &[f64], _rows: usize, _by_next: &[f64]) -> Result<Slopes, StepError> {
        Err(StepError::Refused("this solver has no slopes: take articulated, or a pure model whose network sees one frame".into()))
    }

    /// The frame to first order: [`Self::back`] with the rows of an identity, so `states` has the matrix A of every environment,
    /// `[2 nv][2 nv]`, and `torques` its B, `[2 nv][joint]`. [`Slopes::forward`] multiplies them with a direction.
    fn linearise(&mut self, batch: &Batch, torques: &[f64]) -> Result<Slopes, StepError> {
        let size = 2 * batch.system.robot.nv();
        let identity: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k % (size + 1) == 0))).collect();
        self.back(batch, torques, size, &identity.repeat(batch.len()))
    }

    /// Itself as what keeps a batch on a graphics card, if that is what it does.
    #[cfg(feature = "cuda")]
    fn resident(&mut self) -> Option<&mut dyn device::Resident> {
        None
    }
}

/// What a [`Solver`] around its field `solver` says of that.
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

    /// Makes environment `to` a copy of `from`, with what the solver remembers of it: under the same torques both go on alike.
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
