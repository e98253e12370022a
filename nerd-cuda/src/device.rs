//! One GPU: context, two streams and compiled kernels.

use std::{cell::RefCell, collections::HashMap, sync::Arc, thread::JoinHandle};

use cudarc::cublas::{CudaBlas, sys as blas};
use cudarc::driver::{self, CudaContext, CudaEvent, CudaFunction, CudaGraph, CudaStream, sys};
use cudarc::nvrtc;

use crate::error::{DeviceError, failed};
use crate::memory::{Buffer, allocate, check_fit};
use crate::{compile::compiled, precision::Precision};

/// Workspace of cuBLAS per stream (bytes). A fixed size keeps cuBLAS's choice of algorithms the same.
const WORKSPACE: usize = 32 << 20;

/// Dynamic shared memory (bytes) that a kernel may use without an opt-in.
const UNASKED: usize = 48 << 10;

/// One of the two streams of a device.
#[derive(Clone, Copy)]
pub enum Lane {
    /// The main stream, the default for all work.
    Main,
    /// The second stream, concurrent with the main stream.
    Side,
}

/// Extent of a grid (in blocks) or of a block (in threads), along x and y.
pub type Extent = (usize, usize);

/// A kernel argument.
#[derive(Clone, Copy)]
pub enum Arg {
    /// An address on the device.
    Ptr(u64),
    /// A 32-bit integer.
    Int(usize),
    /// A 64-bit integer.
    Long(u64),
    /// f32.
    Float(f32),
    /// f64.
    Double(f64),
}

struct Queue {
    stream: Arc<CudaStream>,
    /// cuBLAS with its workspace; absent until [`Device::with_products`].
    blas: Option<(CudaBlas, Buffer<u8>)>,
}

/// A GPU with the kernels compiled for it.
pub struct Device {
    context: Arc<CudaContext>,
    kernels: HashMap<&'static str, CudaFunction>,
    queues: RefCell<Arc<[Queue; 2]>>,
    pub(crate) precision: Precision,
}

/// A compilation on another thread. Dropping this value waits for the compilation's end: the process must not exit
/// inside the compiler.
pub struct Foreseen(Option<JoinHandle<bool>>);

impl Drop for Foreseen {
    fn drop(&mut self) {
        self.0.take().map(JoinHandle::join);
    }
}

impl Device {
    /// Opens the first visible GPU (`CUDA_VISIBLE_DEVICES` selects it) and compiles `source`. Matrix products need
    /// [`Device::with_products`].
    pub fn open(source: &str, kernels: &[&'static str]) -> Result<Self, DeviceError> {
        // cudarc panics on a missing library, so check for it first.
        // SAFETY: looks for the library by name and loads it.
        present("driver (libcuda)", unsafe { sys::is_culib_present() })?;
        // SAFETY: as above.
        present("NVRTC (libnvrtc)", unsafe { nvrtc::sys::is_culib_present() })?;
        let context = CudaContext::new(0).map_err(failed("no usable GPU"))?;
        let queue = || context.new_stream().map(|stream| Queue { stream, blas: None }).map_err(failed("stream"));
        let queues = RefCell::new(Arc::new([queue()?, queue()?]));
        let mut device = Self { context, kernels: HashMap::new(), queues, precision: Precision::default() };
        device.add(source, kernels)?;
        Ok(device)
    }

    /// Compiles another source and adds its kernels. The new kernels must have other names than the kernels already
    /// loaded.
    pub fn add(&mut self, source: &str, kernels: &[&'static str]) -> Result<(), DeviceError> {
        let ptx = compiled(source, self.capability()?)?;
        let module = self.context.load_module(ptx).map_err(failed("kernels do not load"))?;
        for name in kernels {
            self.kernels.insert(name, module.load_function(name).map_err(failed(name))?);
        }
        Ok(())
    }

    /// Starts to compile `source` on another thread, for a device that will soon be opened with this source. A failure
    /// to compile shows when the device is opened.
    pub fn foresee(&self, source: &str) -> Result<Foreseen, DeviceError> {
        let (capability, source) = (self.capability()?, source.to_string());
        Ok(Foreseen(std::thread::Builder::new().spawn(move || compiled(&source, capability).is_ok()).ok()))
    }

    /// Compute capability of the GPU: major, minor.
    pub fn capability(&self) -> Result<(i32, i32), DeviceError> {
        self.context.compute_capability().map_err(failed("compute capability"))
    }

    /// Largest shared memory (bytes) that a block may use with an opt-in.
    pub fn shared(&self) -> Result<usize, DeviceError> {
        let most = sys::CUdevice_attribute::CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_BLOCK_OPTIN;
        Ok(self.context.attribute(most).map_err(failed("shared memory"))? as usize)
    }

    /// Adds cuBLAS to both streams, with the arithmetic of `precision`.
    pub fn with_products(mut self, precision: Precision) -> Result<Self, DeviceError> {
        // SAFETY: looks for the library by name and loads it.
        present("cuBLAS (libcublas)", unsafe { blas::is_culib_present() })?;
        let mut queues = [Lane::Main, Lane::Side].map(|lane| Queue { stream: self.stream(lane), blas: None });
        for queue in &mut queues {
            let blas = CudaBlas::new(queue.stream.clone()).map_err(failed("cuBLAS"))?;
            let workspace = allocate::<u8>(&self.context, WORKSPACE)?;
            // SAFETY: the workspace has this many bytes, and the queue keeps it as long as the handle.
            unsafe { blas::cublasSetWorkspace_v2(*blas.handle(), workspace.ptr as *mut _, WORKSPACE) }
                .result()
                .map_err(failed("cuBLAS workspace"))?;
            queue.blas = Some((blas, workspace));
        }
        (self.queues, self.precision) = (RefCell::new(Arc::new(queues)), precision);
        Ok(self)
    }

    /// Moves all further work to the streams of `other`, main to main and side to side. Both devices must be on the
    /// same GPU. If `self` uses matrix products, `other` must have cuBLAS too.
    pub fn join(&self, other: &Self) -> Result<(), DeviceError> {
        self.wait()?;
        let theirs = other.queues.borrow().clone();
        *self.queues.borrow_mut() = theirs;
        Ok(())
    }

    /// Allocates zeroed memory for `len` values.
    pub fn zeros<T: Copy>(&self, len: usize) -> Result<Buffer<T>, DeviceError> {
        allocate(&self.context, len)
    }

    /// Allocates device memory and copies `values` to it.
    pub fn upload<T: Copy>(&self, values: &[T]) -> Result<Buffer<T>, DeviceError> {
        let buffer = self.zeros(values.len())?;
        self.write(&buffer, values)?;
        Ok(buffer)
    }

    /// Copies `values` to the start of `buffer`, after all queued work.
    pub fn write<T: Copy>(&self, buffer: &Buffer<T>, values: &[T]) -> Result<(), DeviceError> {
        self.write_at(buffer, 0, values)
    }

    /// Copies `values` to `buffer` from entry `first` on, after all queued work.
    pub fn write_at<T: Copy>(&self, buffer: &Buffer<T>, first: usize, values: &[T]) -> Result<(), DeviceError> {
        check_fit(buffer, first + values.len())?;
        if values.is_empty() {
            return Ok(());
        }
        self.wait()?;
        // A direct copy from pageable memory may return before it is complete, so copy in stream order and synchronise.
        let stream = self.stream(Lane::Main);
        self.bind()?;
        // SAFETY: the values fit into the buffer (`check_fit`), and the stream is synchronised before they may be
        // dropped.
        unsafe { driver::result::memcpy_htod_async(buffer.at(first), values, stream.cu_stream()) }
            .map_err(failed("copy to the device"))?;
        stream.synchronize().map_err(failed("copy to the device"))
    }

    /// Copies the start of `buffer` to `values`, after all queued work.
    pub fn read<T: Copy>(&self, buffer: &Buffer<T>, values: &mut [T]) -> Result<(), DeviceError> {
        check_fit(buffer, values.len())?;
        self.wait()?;
        // SAFETY: the buffer holds at least as many values (`check_fit`) of a type without padding or pointers.
        unsafe { driver::result::memcpy_dtoh_sync(values, buffer.ptr) }.map_err(failed("copy from the device"))
    }

    /// Copies all values of `buffer` to the host, after all queued work.
    pub fn download<T: Copy + Default>(&self, buffer: &Buffer<T>) -> Result<Vec<T>, DeviceError> {
        let mut values = vec![T::default(); buffer.len];
        self.read(buffer, &mut values)?;
        Ok(values)
    }

    /// Sets the 32-bit word at address `at`, in order of the main stream, without waiting.
    pub fn set_word(&self, at: u64, bits: u32) -> Result<(), DeviceError> {
        self.bind()?;
        // SAFETY: the caller passes the address of a word of a living buffer.
        unsafe { sys::cuMemsetD32Async(at, bits, 1, self.stream(Lane::Main).cu_stream()) }
            .result()
            .map_err(failed("memset"))
    }

    /// Blocks until both streams are done.
    pub fn wait(&self) -> Result<(), DeviceError> {
        self.queues.borrow().iter().try_for_each(|q| q.stream.synchronize()).map_err(failed("the device stopped"))
    }

    /// A new event for [`Device::mark`] and [`Device::after`].
    pub fn event(&self) -> Result<CudaEvent, DeviceError> {
        self.context.new_event(None).map_err(failed("event"))
    }

    /// Records `event` behind the work queued on `lane` so far.
    pub fn mark(&self, lane: Lane, event: &CudaEvent) -> Result<(), DeviceError> {
        event.record(&self.stream(lane)).map_err(failed("event"))
    }

    /// Makes later work on `lane` wait for `event`.
    pub fn after(&self, lane: Lane, event: &CudaEvent) -> Result<(), DeviceError> {
        self.stream(lane).wait(event).map_err(failed("event"))
    }

    /// Captures the work that `work` queues as one graph.
    pub(crate) fn capture<E: From<DeviceError>>(&self, work: impl FnOnce() -> Result<(), E>) -> Result<CudaGraph, E> {
        let stream = self.stream(Lane::Main);
        stream
            .begin_capture(sys::CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_RELAXED)
            .map_err(failed("graph capture"))?;
        let done = work();
        let graph = stream.end_capture(sys::CUgraphInstantiate_flags(0)).map_err(failed("graph capture"));
        done?;
        graph?.ok_or_else(|| DeviceError("graph capture gave nothing".into()).into())
    }

    /// Launches a kernel on the main stream, with `shared` bytes of dynamic shared memory.
    pub fn launch(
        &self,
        kernel: &str,
        grid: Extent,
        block: Extent,
        shared: usize,
        args: &[Arg],
    ) -> Result<(), DeviceError> {
        self.launch_on(Lane::Main, kernel, grid, block, shared, args)
    }

    /// Launches a kernel on the main stream, in `blocks` of `threads` along x.
    pub fn launch_blocks(&self, kernel: &str, blocks: usize, threads: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.launch(kernel, (blocks, 1), (threads, 1), 0, args)
    }

    /// Launches a kernel on the main stream, with a thread for each of `count` entries, in blocks of `threads`.
    pub fn launch_each(&self, kernel: &str, count: usize, threads: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.launch_blocks(kernel, count.div_ceil(threads), threads, args)
    }

    /// Launches a kernel on `lane`, with `shared` bytes of dynamic shared memory.
    pub fn launch_on(
        &self,
        lane: Lane,
        kernel: &str,
        grid: Extent,
        block: Extent,
        shared: usize,
        args: &[Arg],
    ) -> Result<(), DeviceError> {
        let function = self.kernels.get(kernel).ok_or_else(|| DeviceError(format!("no kernel `{kernel}`")))?;
        // Little endian: a 32-bit argument is the low half of its 64-bit slot.
        let mut slots: Vec<u64> = args.iter().map(Arg::bits).collect();
        let mut pointers: Vec<_> = slots.iter_mut().map(|s| (s as *mut u64).cast()).collect();
        let (grid, block) = ((grid.0 as u32, grid.1 as u32, 1), (block.0 as u32, block.1 as u32, 1));
        self.bind()?;
        if shared > UNASKED {
            let most = sys::CUfunction_attribute::CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES;
            function.set_attribute(most, shared as i32).map_err(failed("shared memory"))?;
        }
        // SAFETY: `pointers` point into `slots`, which lives through the call; the caller passes the kernel's own
        // arguments, in order, with addresses of living buffers.
        unsafe {
            driver::result::launch_kernel(
                function.cu_function(),
                grid,
                block,
                shared as u32,
                self.stream(lane).cu_stream(),
                &mut pointers,
            )
        }
        .map_err(|e| DeviceError(format!("kernel `{kernel}`: {e:?}")))
    }

    pub(crate) fn bind(&self) -> Result<(), DeviceError> {
        self.context.bind_to_thread().map_err(failed("context"))
    }

    pub(crate) fn stream(&self, lane: Lane) -> Arc<CudaStream> {
        self.queues.borrow()[lane as usize].stream.clone()
    }

    pub(crate) fn blas(&self, lane: Lane) -> Result<blas::cublasHandle_t, DeviceError> {
        let missing = || DeviceError("this device was opened without matrix products".into());
        self.queues.borrow()[lane as usize].blas.as_ref().map(|(blas, _)| *blas.handle()).ok_or_else(missing)
    }

    /// Whether the main stream is capturing work into a graph.
    pub(crate) fn captures(&self) -> Result<bool, DeviceError> {
        let status = self.stream(Lane::Main).capture_status().map_err(failed("graph capture"))?;
        Ok(status != sys::CUstreamCaptureStatus::CU_STREAM_CAPTURE_STATUS_NONE)
    }
}

/// An error if a library was not found.
fn present(name: &str, found: bool) -> Result<(), DeviceError> {
    let missing = || {
        DeviceError(format!("the CUDA {name} was not found by the dynamic loader; is its folder in LD_LIBRARY_PATH?"))
    };
    found.then_some(()).ok_or_else(missing)
}

/// The arguments of a kernel, in the kernel's order: addresses, buffers, whole numbers, f32 and f64. Each is passed by
/// its type.
#[macro_export]
macro_rules! args {
    ($($x:expr),* $(,)?) => { [$($crate::Arg::from($x)),*] };
}

macro_rules! from {
    ($($type:ty => $kind:ident),+) => { $(impl From<$type> for Arg {
        fn from(x: $type) -> Self {
            Self::$kind(x)
        }
    })+ };
}

from!(u64 => Ptr, usize => Int, f32 => Float, f64 => Double);

impl<T> From<&Buffer<T>> for Arg {
    fn from(buffer: &Buffer<T>) -> Self {
        Self::Ptr(buffer.ptr)
    }
}

impl Arg {
    fn bits(&self) -> u64 {
        match *self {
            Self::Ptr(x) | Self::Long(x) => x,
            Self::Int(x) => x as u64,
            Self::Float(x) => x.to_bits().into(),
            Self::Double(x) => x.to_bits(),
        }
    }
}
