//! What PPO asks of the world: many environments that are stepped at once and begin anew by themselves.

use nerd_sim::solver::StepError;
use nerd_tasks::{Episodes, Snapshot, StepResult};

/// Environments of one task.
pub trait Environments {
    /// How many.
    fn count(&self) -> usize;
    /// Numbers of an observation.
    fn observation_dim(&self) -> usize;
    /// Numbers of an action.
    fn action_dim(&self) -> usize;
    /// Observations `[env][observation_dim]` of the present states.
    fn observations(&self) -> &[f64];
    /// One step under `actions` (`[env][action_dim]`).
    ///
    /// # Errors
    /// If the solver cannot step them.
    fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError>;
    /// The same as a world on a device with the solver that moves it, where they are that; from then on they are stepped there.
    ///
    /// # Errors
    /// If the device fails.
    #[cfg(feature = "cuda")]
    fn on_device(&mut self) -> Result<Option<(&mut super::World, &mut dyn nerd_sim::articulated::device::Resident)>, StepError> {
        Ok(None)
    }
    /// What later steps depend on.
    ///
    /// # Errors
    /// If not all of them can be asked.
    fn snapshot(&self) -> Result<Snapshot, StepError>;
    /// Goes on where a snapshot was taken.
    ///
    /// # Errors
    /// If it is of other environments.
    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StepError>;
}

impl Environments for Episodes {
    fn count(&self) -> usize {
        self.len()
    }

    fn observation_dim(&self) -> usize {
        self.task.observation_dim()
    }

    fn action_dim(&self) -> usize {
        self.task.action_dim()
    }

    fn observations(&self) -> &[f64] {
        self.observations()
    }

    fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError> {
        self.step(actions)
    }

    fn snapshot(&self) -> Result<Snapshot, StepError> {
        Ok(self.snapshot())
    }

    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StepError> {
        self.restore(snapshot)
    }
}
