//! Interface of everything that advances environments on a device.

use nerd_cuda::{Device, DeviceError};

use super::program::Reach;
use crate::prelude::*;
use crate::solver::device::{Back, Held, Trail};

/// Threads of a block: one warp. With fewer threads an access of local memory costs as much; with more, a small batch
/// does not spread over the whole device. Measured on an H200 with 2 to 64 threads.
pub const BLOCK: usize = 32;

/// Advances environments on a device. Calls fail without a device, on an error of the device or without enough memory.
/// Refusals name the unsupported part and where it is supported.
pub trait Motion: Send {
    /// Capabilities beyond stepping states.
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    /// Refuses a batch that no kernel supports, even if the capabilities admit it.
    fn check(&self, _batch: &Batch) -> Result<(), StepError> {
        Ok(())
    }

    /// Makes kernels for a batch of this reach, and discards earlier kernels and memory.
    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError>;

    /// The device with its kernels, once opened.
    fn device(&self) -> Option<&Device>;

    /// Advances the batch in `held` by `frames` frames; `first`: frame count of each environment before the first of
    /// these frames. With `hold` one set of torques acts in all frames, otherwise there is one set per frame.
    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError>;

    /// Refuses a batch without gradients on the device.
    fn goes_back(&self, _batch: &Batch) -> Result<(), StepError> {
        Err(StepError::Refused("this solver has no gradients on a card: take them on the CPU".into()))
    }

    /// Allocates memory for gradients over this many frames of a batch that [`Motion::goes_back`] has admitted.
    fn keep(&mut self, _batch: &Batch, _frames: usize) -> Result<(), StepError> {
        Ok(())
    }

    /// See [`Resident::recall`].
    fn recall(&self, _held: &Held, _trail: Trail) -> Result<(), DeviceError> {
        Ok(())
    }

    /// See [`Resident::back`].
    fn back(&self, _held: &Held, _trail: Trail, _back: Back) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Clears the memory of one environment, as of its past torques.
    fn reset(&mut self, _env: usize) {}

    /// Clears the memory of environments that do not continue at these frame counts; [`Motion::advance`] begins with
    /// this. Afterwards callers of [`Motion::frame`] clear memory themselves, through [`Motion::memory`].
    fn follow(&mut self, _first: &[u64]) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Device address of 32-bit counters, one per environment, of the frames in memory; 0 without memory.
    fn memory(&self) -> u64 {
        0
    }

    /// Steps the batch in `held` by one frame, on the device's main stream. Environments with a fault may keep their
    /// state.
    fn frame(&self, held: &Held) -> Result<(), DeviceError>;
}
