//! Work that is recorded once and then launched as a whole.

use std::cell::RefCell;

use cudarc::driver::CudaGraph;

use crate::device::{Device, Lane};
use crate::error::{DeviceError, failed};

/// Work that runs kernel by kernel at its first call, is captured there, and is one graph from the second call on. The memory it reads and
/// writes must stay in place as long as its key is the same. Within the capture of other work it becomes part of that graph.
pub struct Replay<K = ()> {
    /// Key, stream on which the graph is launched, graph.
    graphs: RefCell<Vec<(K, usize, CudaGraph)>>,
    most: usize,
}

// SAFETY: the driver forbids using a graph from two threads at once, but allows another thread at another time. This type is not `Sync`, so
// one thread has it at a time; launching binds the context to the calling thread.
unsafe impl<K: Send> Send for Replay<K> {}

impl<K> Default for Replay<K> {
    fn default() -> Self {
        Self::keeping(1)
    }
}

impl<K> Replay<K> {
    /// Keeps the graphs of the last `most` keys.
    pub fn keeping(most: usize) -> Self {
        Self { graphs: RefCell::default(), most }
    }
}

impl<K: PartialEq> Replay<K> {
    /// Runs `work`, which must be the same for the same `key`; `what` names it in an error.
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
        if let Some((.., graph)) = self.graphs.borrow().iter().find(|(made_for, on, _)| *made_for == key && *on == stream) {
            return Ok(graph.launch().map_err(failed(what))?);
        }
        // Once outside of a capture, so that libraries finish their lazy loading.
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
