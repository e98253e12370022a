//! What moves environments on a device, as those that use it see it.

use nerd_cuda::{Device, DeviceError};

use super::program::Reach;
use crate::prelude::*;
use crate::solver::device::{Back, Held, Trail};

/// Environments of a block: a full warp, since an access of local memory costs as much for fewer; no more, so that a small batch spreads
/// over the whole device. Measured on an H200 with 2 to 64.
pub const BLOCK: usize = 32;

/// What moves environments on a device. Calls fail if there is none, it fails or its memory is not enough; those that refuse say what, and where
/// that is done.
pub trait Motion: Send {
    /// What it can do beside stepping states.
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    /// Refuses a batch that it has no kernel for, whatever its capabilities.
    fn check(&self, _batch: &Batch) -> Result<(), StepError> {
        Ok(())
    }

    /// Makes kernels for a batch of this reach, and forgets all that was before.
    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError>;

    /// The device with its kernels, once opened.
    fn device(&self) -> Option<&Device>;

    /// So many frames of the batch that `held` took over, the first of them `frames[env]` by the environments' own count. Torques are held
    /// over all frames, or there is a set for each.
    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError>;

    /// Refuses a batch whose frames it cannot go back over.
    fn goes_back(&self, _batch: &Batch) -> Result<(), StepError> {
        Err(StepError::Refused("this solver has no slopes on a card: take them on the CPU".into()))
    }

    /// Makes room for the way back over so many frames of the batch, which [`Motion::goes_back`] has admitted.
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

    /// Clears what is remembered of an environment.
    fn reset(&mut self, _env: usize) {}

    /// Whether the next frame depends on some before.
    fn remembers(&self) -> bool {
        false
    }

    /// What is remembered of environments that do not follow on these frames of theirs is forgotten, as [`Motion::advance`] begins. From
    /// here on whoever calls [`Motion::frame`] sees to that, by [`Motion::memory`].
    fn follow(&mut self, _first: &[u64]) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Where it counts on the device, in 32 bits, the frames that it remembers of each environment; 0 if it remembers nothing.
    fn memory(&self) -> u64 {
        0
    }

    /// One frame of what `held` holds, on the device's main stream. Environments whose fault is not 0 may stay as they are.
    fn frame(&self, held: &Held) -> Result<(), DeviceError>;
}
