//! Libraries beside this one on the same GPU, whose streams go by turns with a device's own.

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
    /// Which GPU it is on, counted from 0.
    pub fn ordinal(&self) -> usize {
        self.0.context().ordinal()
    }

    /// The driver's handle of it, with which another library makes it wait.
    pub fn handle(&self) -> usize {
        self.0.cu_stream() as usize
    }

    /// Waits for what is given to it until now.
    pub fn wait(&self) -> Result<(), DeviceError> {
        self.0.synchronize().map_err(failed("the device stopped"))
    }

    /// Lets the stream of this handle, another library's, go on only after what is given to this one until now. 1 is the driver's default
    /// stream, 2 that of a thread.
    pub fn lead(&self, theirs: usize) -> Result<(), DeviceError> {
        let event = self.0.record_event(None).map_err(failed("event"))?;
        // SAFETY: both are of the driver; a handle that is none is an error of its.
        unsafe { result::stream::wait_event(theirs as sys::CUstream, event.cu_event(), sys::CUevent_wait_flags::CU_EVENT_WAIT_DEFAULT) }
            .map_err(failed("another library's stream"))
    }
}
