//! Work that is recorded once and then launched as a whole.

use std::cell::RefCell;

use cudarc::driver::CudaGraph;

use crate::device::{Device, Lane};
use crate::error::{DeviceError, failed};

/// Work that runs kernel by kernel at its first call, is captured there, and is one graph from the second call on. What it reads and writes
/// must stay where it is as long as its key is the same. Within the capture of other work it is a part of that.
pub struct Replay<K = ()> {
    /// With the stream that each is launched on.
    graphs: RefCell<Vec<(K, usize, CudaGraph)>>,
    most: usize,
}

// SAFETY: the driver wants graphs never used by two threads at once, and says nothing against another thread at another time.
// This type is not `Sync`, so one thread has it at a time; launching binds the context to the thread that calls.
unsafe impl<K: Send> Send for Replay<K> {}

impl<K> Default for Replay<K> {
    fn default() -> Self {
        Self::keeping(1)
    }
}

impl<K> Replay<K> {
    /// Keeps the graphs of so many keys, the last ones.
    pub fn keeping(most: usize) -> Self {
        Self { graphs: RefCell::default(), most }
    }
}

impl<K: PartialEq> Replay<K> {
    /// Does `work`, which is the same as long as `key` is; `what` names it in an error.
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
        // Once outside of a capture, so that libraries have loaded what they load at their first call.
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
