//! CUDA graphs: work captured once, then launched as a whole.

use std::cell::RefCell;

use cudarc::driver::CudaGraph;

use crate::device::{Device, Lane};
use crate::error::{DeviceError, failed};

/// Runs work kernel by kernel at the first call and captures it as a CUDA graph; later calls launch the graph. For one
/// key, the memory that the work reads and writes must stay in place. Inside another capture, the work becomes part of
/// that capture's graph.
pub struct Replay<K = ()> {
    /// Key, stream at capture, graph; oldest first.
    graphs: RefCell<Vec<(K, usize, CudaGraph)>>,
    most: usize,
}

// SAFETY: the driver lets threads use a graph one after the other, but not at once. `Replay` is not `Sync`, and a
// launch binds the context to the calling thread.
unsafe impl<K: Send> Send for Replay<K> {}

impl<K> Default for Replay<K> {
    fn default() -> Self {
        Self::keeping(1)
    }
}

impl<K> Replay<K> {
    /// Keeps the last `most` graphs captured.
    pub fn keeping(most: usize) -> Self {
        Self { graphs: RefCell::default(), most }
    }
}

impl<K: PartialEq> Replay<K> {
    /// Runs `work`, which must be the same for equal keys. `what` names the work in errors.
    pub fn run<E: From<DeviceError>>(
        &self,
        device: &Device,
        what: &'static str,
        key: K,
        work: impl Fn() -> Result<(), E>,
    ) -> Result<(), E> {
        if device.captures()? {
            return work();
        }
        let stream = device.stream(Lane::Main).cu_stream() as usize;
        if let Some((.., graph)) =
            self.graphs.borrow().iter().find(|(made_for, on, _)| *made_for == key && *on == stream)
        {
            return Ok(graph.launch().map_err(failed(what))?);
        }
        // Run once without capture, so that libraries finish their lazy loading.
        work()?;
        device.wait()?;
        let graph = device.capture(work)?;
        let mut graphs = self.graphs.borrow_mut();
        graphs.push((key, stream, graph));
        let old = graphs.len().saturating_sub(self.most);
        graphs.drain(..old);
        Ok(())
    }
}
