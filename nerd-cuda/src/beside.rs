//! Sharing a GPU with other libraries: orders their streams and the device's stream by events.

use std::sync::Arc;

use cudarc::driver::{CudaStream, result, sys};

use crate::device::{Device, Lane};
use crate::error::{DeviceError, failed};

/// The main stream of a device, for other libraries.
#[derive(Clone)]
pub struct Beside(Arc<CudaStream>);

impl Device {
    /// The device's main stream, until it joins another device ([`Device::join`]).
    pub fn beside(&self) -> Beside {
        Beside(self.stream(Lane::Main))
    }
}

impl Beside {
    /// Ordinal of the GPU, from 0.
    pub fn ordinal(&self) -> usize {
        self.0.context().ordinal()
    }

    /// The driver's handle of the stream; another library can wait on it.
    pub fn handle(&self) -> usize {
        self.0.cu_stream() as usize
    }

    /// Blocks until the work queued on the stream so far is done.
    pub fn wait(&self) -> Result<(), DeviceError> {
        self.0.synchronize().map_err(failed("the device stopped"))
    }

    /// Makes another library's stream, given by handle, wait for the work queued on this stream so far. Handle 1 is the
    /// driver's default stream, 2 the per-thread default stream.
    pub fn lead(&self, theirs: usize) -> Result<(), DeviceError> {
        let event = self.0.record_event(None).map_err(failed("event"))?;
        // SAFETY: both handles are the driver's, and it returns an error for an invalid handle.
        unsafe {
            result::stream::wait_event(
                theirs as sys::CUstream,
                event.cu_event(),
                sys::CUevent_wait_flags::CU_EVENT_WAIT_DEFAULT,
            )
        }
        .map_err(failed("another library's stream"))
    }
}
