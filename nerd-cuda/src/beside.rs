//! Sharing a GPU with other libraries: their streams and a device's own wait for each other.

use std::sync::Arc;

use cudarc::driver::{CudaStream, result, sys};

use crate::device::{Device, Lane};
use crate::error::{DeviceError, failed};

/// A device's main stream, as other libraries see it.
#[derive(Clone)]
pub struct Beside(Arc<CudaStream>);

impl Device {
    /// Its main stream, until it joins another device.
    pub fn beside(&self) -> Beside {
        Beside(self.stream(Lane::Main))
    }
}

impl Beside {
    /// Ordinal of its GPU, from 0.
    pub fn ordinal(&self) -> usize {
        self.0.context().ordinal()
    }

    /// The driver's handle of the stream, for another library to wait on.
    pub fn handle(&self) -> usize {
        self.0.cu_stream() as usize
    }

    /// Waits for the work given to it so far.
    pub fn wait(&self) -> Result<(), DeviceError> {
        self.0.synchronize().map_err(failed("the device stopped"))
    }

    /// Makes another library's stream, by its handle, wait for the work given to this one so far. Handle 1 is the driver's default stream,
    /// 2 the per-thread default stream.
    pub fn lead(&self, theirs: usize) -> Result<(), DeviceError> {
        let event = self.0.record_event(None).map_err(failed("event"))?;
        // SAFETY: both are the driver's; it returns an error for an invalid handle.
        unsafe { result::stream::wait_event(theirs as sys::CUstream, event.cu_event(), sys::CUevent_wait_flags::CU_EVENT_WAIT_DEFAULT) }
            .map_err(failed("another library's stream"))
    }
}
