//! One GPU: context, the two streams, compiled kernels, cuBLAS, and memory. Nothing here knows the network.

use std::collections::HashMap;
use std::marker::PhantomData;
use std::sync::Arc;

use cudarc::cublas::{self, CudaBlas, sys as blas};
use cudarc::driver::{self, CudaContext, CudaEvent, CudaFunction, CudaStream, sys};
use cudarc::nvrtc::{self, CompileOptions};

use super::Precision;
use super::graph::Graph;
use crate::learner::LearnError;

/// Bytes cuBLAS may use per stream; fixed, so that it always chooses the same algorithms.
const WORKSPACE: usize = 32 << 20;

/// `LearnError::Device` saying what failed.
pub(super) fn failed<E: std::fmt::Debug>(what: &'static str) -> impl Fn(E) -> LearnError {
    move |e| LearnError::Device(format!("{what}: {e:?}"))
}

/// Which of the two streams; weight gradients run on `Side` beside the chain of activations on `Main`.
#[derive(Clone, Copy)]
pub(super) enum Lane {
    Main,
    Side,
}

/// Whether an operand of a product is transposed.
#[derive(Clone, Copy)]
pub(super) enum Op {
    Plain,
    Transposed,
}

/// Shapes of a batch of equal products: `c = op(a) op(b)` with `c` of `m x n`, inner size `k`.
#[derive(Clone, Copy)]
pub(super) struct Batch {
    pub ops: (Op, Op),
    /// `m`, `n`, `k`.
    pub size: (usize, usize, usize),
    pub count: usize,
}

/// A kernel argument.
#[derive(Clone, Copy)]
pub(super) enum Arg {
    Ptr(u64),
    Int(usize),
    Long(u64),
    Float(f32),
    Double(f64),
}

/// Device memory of `len` values, freed on drop.
pub(super) struct Buffer<T> {
    pub ptr: u64,
    pub len: usize,
    context: Arc<CudaContext>,
    kind: PhantomData<T>,
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        let freed = self.context.bind_to_thread().and_then(|()| unsafe { driver::result::free_sync(self.ptr) });
        self.context.record_err(freed);
    }
}

impl<T> Buffer<T> {
    /// Address of entry `i`.
    pub fn at(&self, i: usize) -> u64 {
        debug_assert!(i <= self.len);
        self.ptr + (i * size_of::<T>()) as u64
    }
}

struct Queue {
    stream: Arc<CudaStream>,
    blas: CudaBlas,
    _workspace: Buffer<u8>,
}

/// The device with the kernels of one network shape.
pub(super) struct Device {
    context: Arc<CudaContext>,
    kernels: HashMap<&'static str, CudaFunction>,
    queues: [Queue; 2],
    pub precision: Precision,
}

impl Device {
    /// Opens GPU 0 and compiles `source`.
    pub fn open(source: &str, kernels: &[&'static str], precision: Precision) -> Result<Self, LearnError> {
        // cudarc panics when a library is absent, so look first.
        let present = unsafe {
            [
                ("driver (libcuda)", sys::is_culib_present()),
                ("cuBLAS (libcublas)", blas::is_culib_present()),
                ("NVRTC (libnvrtc)", nvrtc::sys::is_culib_present()),
            ]
        };
        if let Some((name, _)) = present.iter().find(|(_, found)| !found) {
            return Err(LearnError::Device(format!(
                "the CUDA {name} was not found by the dynamic loader; is its folder in LD_LIBRARY_PATH?"
            )));
        }
        let context = CudaContext::new(0).map_err(failed("no usable GPU"))?;
        let (major, minor) = context.compute_capability().map_err(failed("compute capability"))?;
        let options = CompileOptions { options: vec![format!("--gpu-architecture=compute_{major}{minor}")], ..Default::default() };
        let ptx = nvrtc::compile_ptx_with_opts(source, options).map_err(failed("kernels do not compile"))?;
        let module = context.load_module(ptx).map_err(failed("kernels do not load"))?;
        let load = |&name: &&'static str| Ok((name, module.load_function(name).map_err(failed(name))?));
        let kernels = kernels.iter().map(load).collect::<Result<_, LearnError>>()?;
        let queue = || -> Result<Queue, LearnError> {
            let stream = context.new_stream().map_err(failed("stream"))?;
            let blas = CudaBlas::new(stream.clone()).map_err(failed("cuBLAS"))?;
            let workspace = allocate::<u8>(&context, WORKSPACE)?;
            unsafe { blas::cublasSetWorkspace_v2(*blas.handle(), workspace.ptr as *mut _, WORKSPACE) }
                .result()
                .map_err(failed("cuBLAS workspace"))?;
            Ok(Queue { stream, blas, _workspace: workspace })
        };
        let queues = [queue()?, queue()?];
        Ok(Self { context, kernels, queues, precision })
    }

    /// Zeroed memory for `len` values.
    pub fn zeros<T: Copy>(&self, len: usize) -> Result<Buffer<T>, LearnError> {
        allocate(&self.context, len)
    }

    /// Memory holding `values`.
    pub fn upload<T: Copy>(&self, values: &[T]) -> Result<Buffer<T>, LearnError> {
        let buffer = self.zeros(values.len())?;
        self.write(&buffer, values)?;
        Ok(buffer)
    }

    /// Copies `values` to the start of `buffer`, after the work before it.
    pub fn write<T: Copy>(&self, buffer: &Buffer<T>, values: &[T]) -> Result<(), LearnError> {
        self.write_at(buffer, 0, values)
    }

    /// Copies `values` to `buffer` from entry `first` on, after the work before it.
    pub fn write_at<T: Copy>(&self, buffer: &Buffer<T>, first: usize, values: &[T]) -> Result<(), LearnError> {
        check_fit(buffer, first + values.len())?;
        if values.is_empty() {
            return Ok(());
        }
        self.wait()?;
        unsafe { driver::result::memcpy_htod_sync(buffer.at(first), values) }.map_err(failed("copy to the device"))
    }

    /// Copies the start of `buffer` to `values`, after the work before it.
    pub fn read<T: Copy>(&self, buffer: &Buffer<T>, values: &mut [T]) -> Result<(), LearnError> {
        check_fit(buffer, values.len())?;
        self.wait()?;
        unsafe { driver::result::memcpy_dtoh_sync(values, buffer.ptr) }.map_err(failed("copy from the device"))
    }

    /// Sets one 32-bit word in stream order, without waiting.
    pub fn set_word(&self, at: u64, bits: u32) -> Result<(), LearnError> {
        self.context.bind_to_thread().map_err(failed("context"))?;
        unsafe { sys::cuMemsetD32Async(at, bits, 1, self.stream(Lane::Main).cu_stream()) }.result().map_err(failed("memset"))
    }

    /// Waits for all work.
    pub fn wait(&self) -> Result<(), LearnError> {
        self.queues.iter().try_for_each(|q| q.stream.synchronize()).map_err(failed("the device stopped"))
    }

    /// An event for [`Device::mark`] and [`Device::after`].
    pub fn event(&self) -> Result<CudaEvent, LearnError> {
        self.context.new_event(None).map_err(failed("event"))
    }

    /// Marks the work given to `lane` until now.
    pub fn mark(&self, lane: Lane, event: &CudaEvent) -> Result<(), LearnError> {
        event.record(self.stream(lane)).map_err(failed("event"))
    }

    /// Lets `lane` go on only after what `event` marks.
    pub fn after(&self, lane: Lane, event: &CudaEvent) -> Result<(), LearnError> {
        self.stream(lane).wait(event).map_err(failed("event"))
    }

    /// Records what `work` gives to the streams as one graph.
    pub fn capture(&self, work: impl FnOnce() -> Result<(), LearnError>) -> Result<Graph, LearnError> {
        let stream = self.stream(Lane::Main);
        stream.begin_capture(sys::CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_RELAXED).map_err(failed("graph capture"))?;
        let done = work();
        let graph = stream.end_capture(sys::CUgraphInstantiate_flags(0)).map_err(failed("graph capture"));
        done?;
        graph?.map(Graph::new).ok_or_else(|| LearnError::Device("graph capture gave nothing".into()))
    }

    /// Launches a kernel on the main stream with `shared` bytes of dynamic shared memory.
    pub fn launch(&self, kernel: &str, grid: (usize, usize), block: (usize, usize), shared: usize, args: &[Arg]) -> Result<(), LearnError> {
        self.launch_on(Lane::Main, kernel, grid, block, shared, args)
    }

    /// Launches a kernel on `lane`.
    pub fn launch_on(
        &self,
        lane: Lane,
        kernel: &str,
        grid: (usize, usize),
        block: (usize, usize),
        shared: usize,
        args: &[Arg],
    ) -> Result<(), LearnError> {
        let function = self.kernels.get(kernel).ok_or_else(|| LearnError::Device(format!("no kernel `{kernel}`")))?;
        // Little endian: a 32-bit argument is the low half of its slot.
        let mut slots: Vec<u64> = args.iter().map(Arg::bits).collect();
        let mut pointers: Vec<_> = slots.iter_mut().map(|s| (s as *mut u64).cast()).collect();
        let (grid, block) = ((grid.0 as u32, grid.1 as u32, 1), (block.0 as u32, block.1 as u32, 1));
        self.context.bind_to_thread().map_err(failed("context"))?;
        unsafe {
            driver::result::launch_kernel(function.cu_function(), grid, block, shared as u32, self.stream(lane).cu_stream(), &mut pointers)
        }
        .map_err(|e| LearnError::Device(format!("kernel `{kernel}`: {e:?}")))
    }

    /// Column-major `c = op(a) op(b) + beta c` with `c` of `m x n` and inner size `k`; leading dimensions `ld`.
    #[allow(clippy::too_many_arguments)]
    pub fn product(
        &self,
        lane: Lane,
        ops: (Op, Op),
        (m, n, k): (usize, usize, usize),
        a: (u64, usize),
        b: (u64, usize),
        beta: f32,
        c: (u64, usize),
    ) -> Result<(), LearnError> {
        let compute = self.compute();
        let (alpha, f32_type) = (1.0f32, blas::cudaDataType::CUDA_R_32F);
        let size = |x: usize| x as i32;
        unsafe {
            cublas::result::gemm_ex(
                *self.queues[lane as usize].blas.handle(),
                ops.0.blas(),
                ops.1.blas(),
                size(m),
                size(n),
                size(k),
                (&raw const alpha).cast(),
                a.0 as *const _,
                f32_type,
                size(a.1),
                b.0 as *const _,
                f32_type,
                size(b.1),
                (&raw const beta).cast(),
                c.0 as *mut _,
                f32_type,
                size(c.1),
                compute,
                blas::cublasGemmAlgo_t::CUBLAS_GEMM_DFALT,
            )
        }
        .map_err(|e| LearnError::Device(format!("matrix product {m} x {n} x {k}: {e:?}")))
    }

    /// Column-major products of a batch; each operand is (address, leading dimension, distance to the next).
    pub fn products(
        &self,
        lane: Lane,
        batch: Batch,
        a: (u64, usize, usize),
        b: (u64, usize, usize),
        c: (u64, usize, usize),
    ) -> Result<(), LearnError> {
        let (alpha, beta, f32_type) = (1.0f32, 0.0f32, blas::cudaDataType::CUDA_R_32F);
        let (m, n, k) = batch.size;
        unsafe {
            blas::cublasGemmStridedBatchedEx(
                *self.queues[lane as usize].blas.handle(),
                batch.ops.0.blas(),
                batch.ops.1.blas(),
                m as i32,
                n as i32,
                k as i32,
                (&raw const alpha).cast(),
                a.0 as *const _,
                f32_type,
                a.1 as i32,
                a.2 as i64,
                b.0 as *const _,
                f32_type,
                b.1 as i32,
                b.2 as i64,
                (&raw const beta).cast(),
                c.0 as *mut _,
                f32_type,
                c.1 as i32,
                c.2 as i64,
                batch.count as i32,
                self.compute(),
                blas::cublasGemmAlgo_t::CUBLAS_GEMM_DEFAULT,
            )
        }
        .result()
        .map_err(|e| LearnError::Device(format!("{} matrix products {m} x {n} x {k}: {e:?}", batch.count)))
    }

    fn compute(&self) -> blas::cublasComputeType_t {
        match self.precision {
            Precision::F32 => blas::cublasComputeType_t::CUBLAS_COMPUTE_32F,
            Precision::Tf32 => blas::cublasComputeType_t::CUBLAS_COMPUTE_32F_FAST_TF32,
        }
    }

    fn stream(&self, lane: Lane) -> &Arc<CudaStream> {
        &self.queues[lane as usize].stream
    }
}

impl Op {
    fn blas(self) -> blas::cublasOperation_t {
        match self {
            Op::Plain => blas::cublasOperation_t::CUBLAS_OP_N,
            Op::Transposed => blas::cublasOperation_t::CUBLAS_OP_T,
        }
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

fn allocate<T>(context: &Arc<CudaContext>, len: usize) -> Result<Buffer<T>, LearnError> {
    let bytes = (len * size_of::<T>()).max(1);
    context.bind_to_thread().map_err(failed("context"))?;
    let ptr =
        unsafe { driver::result::malloc_sync(bytes) }.map_err(|e| LearnError::Device(format!("allocating {} MiB: {e:?}", bytes >> 20)))?;
    let buffer = Buffer { ptr, len, context: context.clone(), kind: PhantomData };
    unsafe { driver::result::memset_d8_sync(ptr, 0, bytes) }.map_err(failed("memset"))?;
    context.synchronize().map_err(failed("memset"))?;
    Ok(buffer)
}

fn check_fit<T>(buffer: &Buffer<T>, len: usize) -> Result<(), LearnError> {
    if len <= buffer.len { Ok(()) } else { Err(LearnError::Device(format!("{len} values for {} on the device", buffer.len))) }
}
