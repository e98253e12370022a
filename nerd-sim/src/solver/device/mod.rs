//! Batches that stay in a GPU's memory.

mod held;
mod torques;

pub use held::Held;
pub(crate) use torques::acting;

use nerd_cuda::{Device, DeviceError};

use super::refusal::StepError;
use crate::batch::Batch;

/// An error of the device as one of a step.
pub fn failed(error: DeviceError) -> StepError {
    StepError::Solver(error.to_string())
}

/// A batch that stays on a device while others work on it there, too.
pub trait Resident {
    /// Takes a batch over; refuses what has no kernel. What the host has of it grows old from here on.
    fn hold(&mut self, batch: &Batch) -> Result<(), StepError>;

    /// The device, and what is held there.
    fn held(&self) -> Option<(&Device, &Held)>;

    /// Where it counts on the device, in 32 bits, the frames that it remembers of each environment; 0 if it remembers nothing.
    fn memory(&self) -> u64;

    /// One frame of what is held, on the device's main stream. Environments whose fault is not 0 may stay as they are.
    fn frame(&mut self) -> Result<(), DeviceError>;
}
