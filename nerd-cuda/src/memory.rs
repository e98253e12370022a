//! Device memory.

use std::{marker::PhantomData, sync::Arc};

use cudarc::driver::{self, CudaContext};

use crate::error::{DeviceError, failed};

/// Device memory for `len` values, freed on drop.
pub struct Buffer<T> {
    /// Address on the device.
    pub ptr: u64,
    /// Number of values.
    pub len: usize,
    context: Arc<CudaContext>,
    kind: PhantomData<T>,
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        // Binding also reports earlier failures, but the memory is freed regardless.
        let bound = self.context.bind_to_thread();
        // SAFETY: `ptr` came from `malloc_sync`, and a buffer is dropped once.
        let freed = unsafe { driver::result::free_sync(self.ptr) };
        self.context.record_err(bound.and(freed));
    }
}

impl<T> Buffer<T> {
    /// Address of entry `i`.
    pub fn at(&self, i: usize) -> u64 {
        debug_assert!(i <= self.len);
        self.ptr + (i * size_of::<T>()) as u64
    }
}

pub(crate) fn allocate<T>(context: &Arc<CudaContext>, len: usize) -> Result<Buffer<T>, DeviceError> {
    let bytes = (len * size_of::<T>()).max(1);
    context.bind_to_thread().map_err(failed("context"))?;
    // SAFETY: the context is bound to this thread.
    let ptr = unsafe { driver::result::malloc_sync(bytes) }
        .map_err(|e| DeviceError(format!("allocating {} MiB: {e:?}", bytes >> 20)))?;
    let buffer = Buffer { ptr, len, context: context.clone(), kind: PhantomData };
    // SAFETY: the allocation has `bytes` bytes.
    unsafe { driver::result::memset_d8_sync(ptr, 0, bytes) }.map_err(failed("memset"))?;
    context.synchronize().map_err(failed("memset"))?;
    Ok(buffer)
}

pub(crate) fn check_fit<T>(buffer: &Buffer<T>, len: usize) -> Result<(), DeviceError> {
    if len <= buffer.len { Ok(()) } else { Err(DeviceError(format!("{len} values for {} on the device", buffer.len))) }
}
