//! A captured graph of kernels.

use cudarc::driver::CudaGraph;

use crate::error::{DeviceError, failed};

/// Work recorded once, and launched again as a whole.
pub struct Graph(CudaGraph);

// SAFETY: the driver wants graphs never used by two threads at once, and says nothing against another thread at another time.
// This type is not `Sync`, so one thread has it at a time; launching binds the context to the thread that calls.
unsafe impl Send for Graph {}

impl Graph {
    pub(crate) fn new(graph: CudaGraph) -> Self {
        Self(graph)
    }

    /// Launches it; `what` names it in an error.
    ///
    /// # Errors
    /// The driver's error.
    pub fn launch(&self, what: &'static str) -> Result<(), DeviceError> {
        self.0.launch().map_err(failed(what))
    }
}
