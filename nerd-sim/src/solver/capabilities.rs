//! What a solver can do beside stepping states.

use super::error::StepError;
use crate::batch::Batch;

/// What a solver can do beside stepping states; ask [`super::Solver::capabilities`] before the first step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capabilities {
    /// Holds a batch's drives inside its frame ([`Batch::drives`]).
    pub drives: bool,
    /// Tells contact forces ([`Batch::contact_force`]).
    pub forces: bool,
    /// Steps a robot of its own in each environment ([`Batch::systems`]).
    pub systems: bool,
}

impl Capabilities {
    /// Refuses a batch that needs what is not there.
    ///
    /// # Errors
    /// [`StepError::Refused`].
    pub fn admit(&self, batch: &Batch) -> Result<(), StepError> {
        let missing = if !self.drives && !batch.drives.is_empty() {
            "this solver has no drives inside its frame: leave `drives` empty and give torques (nerd_sim::control), or step with articulated"
        } else if !self.systems && !batch.systems.is_empty() {
            "this solver knows one robot for all environments: leave `systems` empty, or step with articulated or rapier"
        } else {
            return Ok(());
        };
        Err(StepError::Refused(missing.into()))
    }
}
