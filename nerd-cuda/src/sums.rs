//! Sums over the GPUs of several processes, by NCCL.
//!
//! The library is loaded at the first sum, so neither a build nor a run on one GPU needs it. Only the functions in use are declared here.
//! NCCL reads `NCCL_NVLS_ENABLE` when it is loaded; set it to 0 where NVLink's multicast is not set up.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::OnceLock;

use libloading::{Library, Symbol};

use crate::device::{Device, Lane};
use crate::{error::DeviceError, memory::Buffer};

/// Without and with the packages for developers.
const NAMES: [&str; 2] = ["libnccl.so.2", "libnccl.so"];
/// `ncclFloat32` and `ncclSum`.
const FLOAT: c_int = 7;
const SUM: c_int = 0;

/// `ncclUniqueId`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Id([u8; 128]);

/// `ncclComm_t`.
type Comm = *mut c_void;

/// What is needed of the library.
struct Nccl {
    id: unsafe extern "C" fn(*mut Id) -> c_int,
    join: unsafe extern "C" fn(*mut Comm, c_int, Id, c_int) -> c_int,
    sum: unsafe extern "C" fn(*const c_void, *mut c_void, usize, c_int, c_int, Comm, *mut c_void) -> c_int,
    abort: unsafe extern "C" fn(Comm) -> c_int,
    words: unsafe extern "C" fn(c_int) -> *const c_char,
    /// Its code has to stay.
    _library: Library,
}

impl Nccl {
    fn get() -> Result<&'static Self, DeviceError> {
        static LOADED: OnceLock<Result<Nccl, DeviceError>> = OnceLock::new();
        LOADED.get_or_init(Self::load).as_ref().map_err(Clone::clone)
    }

    fn load() -> Result<Self, DeviceError> {
        // SAFETY: loading it runs its initialisers, as for any library; types are those of `nccl.h`, the same in all of version 2.
        unsafe {
            let library = NAMES.iter().find_map(|name| Library::new(*name).ok());
            let missing = "NCCL (libnccl.so.2) was not found by the dynamic loader; is its folder in LD_LIBRARY_PATH?";
            let library = library.ok_or_else(|| DeviceError(missing.into()))?;
            Ok(Self {
                id: *symbol(&library, "ncclGetUniqueId")?,
                join: *symbol(&library, "ncclCommInitRank")?,
                sum: *symbol(&library, "ncclAllReduce")?,
                abort: *symbol(&library, "ncclCommAbort")?,
                words: *symbol(&library, "ncclGetErrorString")?,
                _library: library,
            })
        }
    }

    fn check(&self, what: &str, code: c_int) -> Result<(), DeviceError> {
        if code == 0 {
            return Ok(());
        }
        // SAFETY: a constant text for every code.
        let words = unsafe { CStr::from_ptr((self.words)(code)) }.to_string_lossy();
        Err(DeviceError(format!("NCCL, {what}: {words}; NCCL_DEBUG=WARN says more")))
    }
}

/// # Safety
/// `T` must be what the library has under this name.
unsafe fn symbol<'a, T>(library: &'a Library, name: &str) -> Result<Symbol<'a, T>, DeviceError> {
    unsafe { library.get(name.as_bytes()) }.map_err(|e| DeviceError(format!("NCCL has no {name}: {e}")))
}

/// A card among those of other processes.
pub struct Sums {
    comm: Comm,
    nccl: &'static Nccl,
}

// SAFETY: NCCL wants a communicator never used by two threads at once; this type is not `Sync`.
unsafe impl Send for Sums {}

impl Sums {
    /// What one process makes and all others have to be given.
    pub fn id() -> Result<Vec<u8>, DeviceError> {
        let (nccl, mut id) = (Nccl::get()?, Id([0; 128]));
        // SAFETY: it writes the 128 bytes.
        nccl.check("id", unsafe { (nccl.id)(&raw mut id) })?;
        Ok(id.0.to_vec())
    }

    /// Joins `world` processes that were given the same `id` and each their `rank`; waits for all of them.
    pub fn join(device: &Device, id: &[u8], rank: usize, world: usize) -> Result<Self, DeviceError> {
        let nccl = Nccl::get()?;
        let id = Id(id.try_into().map_err(|_| DeviceError(format!("NCCL's id has 128 bytes, not {}", id.len())))?);
        let mut comm = std::ptr::null_mut();
        device.bind()?;
        // SAFETY: the device's context is this thread's.
        nccl.check("joining", unsafe { (nccl.join)(&raw mut comm, world as c_int, id, rank as c_int) })?;
        Ok(Self { comm, nccl })
    }

    /// Adds up the buffers of all ranks in place, as work of the main stream. All of them get the same bits.
    pub fn sum(&self, device: &Device, buffer: &Buffer<f32>) -> Result<(), DeviceError> {
        device.bind()?;
        let (at, stream) = (buffer.ptr as *mut c_void, device.stream(Lane::Main).cu_stream());
        // SAFETY: the buffer is on this device and has the given length.
        self.nccl.check("sum", unsafe { (self.nccl.sum)(at, at, buffer.len, FLOAT, SUM, self.comm, stream.cast()) })
    }
}

impl Drop for Sums {
    fn drop(&mut self) {
        // Not `ncclCommDestroy`, which waits for ranks that may be gone. Whoever drops this in peace has waited for all before.
        // SAFETY: it is used no more.
        let _ = unsafe { (self.nccl.abort)(self.comm) };
    }
}
